# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Matching of two maps that remembers what came of it.

A campaign replays the same few maps in ever new orders: what was matched once need not be again.
The result is that of the real matcher, to the last bit.
"""

from dataclasses import replace
from hashlib import blake2b
from typing import Any

import numpy as np
from somfusion_ros.fusion.alignment import align, Alignment
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.grid import Grid
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.screening import outline, screen, Screening
from somfusion_ros.team.session import FusionSession

LARGEST = 20000    # results that are remembered


class Matching(Matchers):
    """The matchers of a session, with a memory that all sessions of a campaign share."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], Any] = {}
        self.asked = self.done = 0

    def align(self, target: Grid, source: Grid, config: FusionConfig,
              cache: FusionCache) -> Alignment:
        """Match two maps."""
        found: Alignment = self._remember(('align', digest(target), digest(source)),
                                          lambda: align(target, source, config, cache=cache))
        return replace(found, seconds={})   # how long it took is no part of a simulation

    def screen(self, own: Grid, clusters: Clusters, config: FusionConfig,
               cache: FusionCache) -> Screening:
        """Compare a map with a peer's clusters."""
        key = 'screen', digest(own), blake2b(np.ascontiguousarray(clusters.centres).data,
                                             digest_size=16).digest()
        found: Screening = self._remember(
            key, lambda: screen(learn(own, config, cache), clusters, config))
        return found

    def clusters(self, session: FusionSession) -> Clusters:
        """Return the clusters that a robot tells of its own map."""
        own = session.own_grid
        found: Clusters = self._remember(('clusters', digest(own)),
                                         lambda: outline(session.learned_own()))
        return found

    def _remember(self, key: tuple[Any, ...], work: Any) -> Any:
        """Return what came of a piece of work before, or do it."""
        self.asked += 1
        if key not in self._known:
            self.done += 1
            if len(self._known) >= LARGEST:
                self._known.clear()
            self._known[key] = work()
        return self._known[key]


def digest(grid: Grid | None) -> bytes:
    """Return bytes that no other map has."""
    if grid is None:
        return b''
    return blake2b(np.ascontiguousarray(grid.evidence).data, digest_size=16, key=repr(
        (grid.resolution, *grid.T_frame_grid)).encode()[:64]).digest()
