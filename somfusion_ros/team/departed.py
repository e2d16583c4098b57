# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the team knows of robots that are gone, for those who come later.

A robot that left, died or is out of reach has mapped something and joined maps. Who knew it tells
the others so, and hands its map on when asked. Of several who knew the same robot, the one that
knows most of its map counts, then the one whose name sorts first, so that all agree.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.members import Team
from somfusion_ros.team.shared_map import SharedMap


@dataclass(frozen=True, eq=False)
class DepartedRobot:
    """A robot that is gone, how many cells of its map are known, and what it had accepted."""

    robot: str
    known: int
    constraints: tuple[MapConstraint, ...] = ()


class DepartedRobots:
    """
    What one robot knows of absent ones, and what its peers say about theirs.

    known is what to tell the others; sources names the peer from which to get the map of an absent
    robot, by the absent one's name.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        self._offers: dict[str, tuple[DepartedRobot, ...]] = {}
        self._counted: dict[str, tuple[SharedMap, int]] = {}
        self.known: tuple[DepartedRobot, ...] = ()
        self.sources: dict[str, str] = {}

    def hear(self, owner: str, departed: tuple[DepartedRobot, ...]) -> None:
        """Replace what a peer knows of absent robots."""
        self._offers[owner] = departed

    def update(self, present: Collection[str]) -> None:
        """Agree with the peers that are present on what is left of those that are not."""
        team = self._team
        mine = {robot: DepartedRobot(robot, self._cells(robot), team.heard_of(robot))
                for robot in team.maps.keys() - set(present) - {team.name}}
        best = self._best(mine, present)
        self.sources = {}
        for robot, (owner, gone) in best.items():
            if owner != team.name:
                team.hear(robot, gone.constraints)
                if robot not in mine or gone.known > mine[robot].known:
                    self.sources[robot] = owner
        self.known = tuple(DepartedRobot(robot, mine[robot].known, team.heard_of(robot))
                           for robot in sorted(mine))

    def maps(self) -> Mapping[str, SharedMap]:
        """Return the maps of the absent robots, by name."""
        return {gone.robot: self._team.maps[gone.robot] for gone in self.known}

    def _best(self, mine: Mapping[str, DepartedRobot],
              present: Collection[str]) -> dict[str, tuple[str, DepartedRobot]]:
        """Choose whose word on each absent robot counts: by its name, who says it, and what."""
        best = {robot: (self._team.name, gone) for robot, gone in mine.items()}
        for owner in sorted(set(present) & self._offers.keys()):
            for gone in self._offers[owner]:
                if gone.robot in present or gone.robot == self._team.name:
                    continue
                held = best.get(gone.robot)
                if held is None or (-gone.known, owner) < (-held[1].known, held[0]):
                    best[gone.robot] = owner, gone
        return best

    def _cells(self, robot: str) -> int:
        """Count the known cells of a robot's map, once per map."""
        shared = self._team.maps[robot]
        counted = self._counted.get(robot)
        if counted is None or counted[0] is not shared:
            counted = shared, int(np.count_nonzero(shared.grid.known))
            self._counted[robot] = counted
        return counted[1]
