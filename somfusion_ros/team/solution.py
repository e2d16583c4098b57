# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the maps of a team lie, by what is said of pairs."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array, Pose
from somfusion_ros.team.constraint import Dropped, MapConstraint


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Where every robot's map lies.

    groups: per connected group T_world_map by robot, the largest first; covariances (3, 3) of
    those poses by robot; constraints that were dropped; pieces: the robots that lie fast by what
    both of a pair say; single: what joins these, and one robot says alone.
    """

    groups: tuple[dict[str, Pose], ...]
    covariances: dict[str, Array]
    dropped: tuple[Dropped, ...] = ()
    pieces: tuple[frozenset[str], ...] = ()
    single: tuple[MapConstraint, ...] = ()

    def group_of(self, robot: str) -> dict[str, Pose]:
        """Return T_world_map by robot of the group that holds a robot."""
        return next((group for group in self.groups if robot in group), {robot: Pose()})
