# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a session compares maps: handed in, so that a simulation can remember what it did."""

from somfusion_ros.fusion.alignment import align, Alignment
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.grid import Grid
from somfusion_ros.team.screening import screen, Screening


class Matchers:
    """The matchers that a robot uses."""

    def align(self, target: Grid, source: Grid, config: FusionConfig,
              cache: FusionCache) -> Alignment:
        """Match two maps."""
        return align(target, source, config, cache=cache)

    def screen(self, own: Grid, clusters: Clusters, config: FusionConfig,
               cache: FusionCache) -> Screening:
        """Compare a map with a peer's clusters, before its whole map is asked for."""
        return screen(learn(own, config, cache), clusters, config)
