# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot has told of itself: its views, and its own constraints between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True, eq=False)
class DrawnScan:
    """A scan that is only drawn: its stamp [s], view, T_view_base (3,), and what it saw."""

    stamp: float
    view: int
    T_view_base: Array
    outline: Outline


@dataclass(frozen=True, eq=False)
class ViewSet:
    """
    The views of one robot in one epoch of its map, as all robots know them.

    stamps (n,) [s]; poses (n, 3) T_map_view, a first guess; clouds of what the views saw; steps
    (n - 1), of which the k-th leads to view k + 1 from one before it, most from view k; loops,
    the robot's other constraints; between are scans on the way from view to view, only drawn.
    """

    stamps: Array
    poses: Array
    clouds: Sequence[Cloud]
    steps: Sequence[Constraint]
    loops: Sequence[Constraint] = ()
    between: Sequence[DrawnScan] = ()

    def __len__(self) -> int:
        return len(self.poses)

    @cached_property
    def centres(self) -> Array:
        """Median points (n, 2) [m] of what the views saw, in their base frames."""
        return np.array([centre(cloud) for cloud in self.clouds]).reshape(-1, 2)
