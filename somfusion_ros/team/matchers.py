# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a session compares maps: handed in, so that a simulation can remember what it did."""

from collections.abc import Iterable, Mapping, Sequence

from somfusion_ros.fusion.alignment import align, Alignment
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.bond_codec import ToldBond
from somfusion_ros.team.bonding import bond_of, rival_of
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.elastic import join
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.graph import solve
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.screening import screen, Screening
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.view_set import ViewSet


class Matchers:
    """The matchers that a robot uses; reader: what unpacks the facts that it hears."""

    reader = FactReader()

    def solve(self, robots: Iterable[str], constraints: Sequence[MapConstraint]) -> Solution:
        """Place every robot's map in the world of its connected group."""
        return solve(robots, constraints)

    def align(self, target: Grid, source: Grid, config: FusionConfig,
              cache: FusionCache) -> Alignment:
        """Match two maps."""
        return align(target, source, config, cache=cache)

    def screen(self, own: Grid, clusters: Clusters, config: FusionConfig,
               cache: FusionCache) -> Screening:
        """Compare a map with a peer's clusters, before its whole map is asked for."""
        return screen(learn(own, config, cache), clusters, config)

    def bond(self, views: Mapping[str, ViewSet], target: str, source: str, T_target_source: Pose
             ) -> Bond:
        """Ask the views of two robots about a pose."""
        return bond_of(views, target, source, T_target_source)

    def rival(self, bond: Bond, views: Mapping[str, ViewSet], T_target_source: Pose
              ) -> Bond | None:
        """Ask the views of a pair about another pose."""
        return rival_of(bond, views, T_target_source)

    def join(self, views: Mapping[str, ViewSet], world: Mapping[str, Pose],
             bonds: Sequence[ToldBond], anchor: str) -> dict[str, Array]:
        """Solve a team's problem."""
        return join(views, world, bonds, anchor=anchor)

    def go_on(self, views: Mapping[str, ViewSet], world: Mapping[str, Pose],
              bonds: Sequence[ToldBond], anchor: str, start: Mapping[str, Array]
              ) -> dict[str, Array]:
        """Solve a team's problem nearly, from where most of it lay (n, 3) by robot."""
        return join(views, world, bonds, anchor=anchor, start=start)

    def draw(self, views: Mapping[str, ViewSet], poses: Mapping[str, Array], resolution: float
             ) -> Grid:
        """Draw a team's views at their poses (n, 3)."""
        return draw_joint(views, poses, resolution)
