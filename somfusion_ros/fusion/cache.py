# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a merge has computed before, so that asking again costs nothing."""

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from somfusion_ros.fusion.segment_cache import SegmentCache
from somfusion_ros.grid import Grid

if TYPE_CHECKING:
    from somfusion_ros.fusion.alignment import Alignment
    from somfusion_ros.fusion.config import FusionConfig
    from somfusion_ros.fusion.learned_map import LearnedMap


class FusionCache:
    """
    Learned segments, learned maps, and answers on pairs of maps.

    Maps and answers are kept with the Grid objects, and go with them. Whoever merges the same
    maps again and again, a robot or a replay, keeps one and hands it to `learn` and `align`.
    """

    def __init__(self) -> None:
        self.segments = SegmentCache()
        self.learned: WeakKeyDictionary[Grid, dict['FusionConfig', 'LearnedMap']] = (
            WeakKeyDictionary())
        self.answers: WeakKeyDictionary[
            Grid, WeakKeyDictionary[Grid, dict['FusionConfig', 'Alignment']]] = WeakKeyDictionary()
