# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the team keeps of robots that are gone, for those who come later.

A robot that left, died or is out of reach has mapped something and joined maps. Who knew it tells
the others so, and hands its map on when asked. Of several who kept something of the same robot,
the one that knows most of its map counts, then the one whose name sorts first, so that all agree.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.team.graph import Edge
from somfusion_ros.team.members import Team
from somfusion_ros.team.shared_map import SharedMap


@dataclass(frozen=True, eq=False)
class Kept:
    """A robot that is gone, how many cells of its map are known, and what it had accepted."""

    robot: str
    known: int
    edges: tuple[Edge, ...] = ()


class Keeping:
    """One robot's memory of absent robots, and what its peers say about theirs."""

    def __init__(self, team: Team) -> None:
        self._team = team
        self._offers: dict[str, tuple[Kept, ...]] = {}
        self._counted: dict[str, tuple[SharedMap, int]] = {}
        self.kept: tuple[Kept, ...] = ()
        self.sources: dict[str, str] = {}

    def hear(self, owner: str, kept: tuple[Kept, ...]) -> None:
        """Take what a peer keeps."""
        self._offers[owner] = kept

    def update(self, alive: Collection[str]) -> None:
        """
        Agree with the peers that are alive on what is left of those that are not.

        Afterwards `kept` is what to tell the others, and `sources` names the peer from which to
        get the map of an absent robot, by the absent one's name.
        """
        team = self._team
        mine = {robot: Kept(robot, self._known(robot), team.heard_of(robot))
                for robot in team.maps.keys() - set(alive) - {team.name}}
        best = {robot: (kept.known, team.name, kept) for robot, kept in mine.items()}
        for owner in sorted(set(alive) & self._offers.keys()):
            for kept in self._offers[owner]:
                if kept.robot in alive or kept.robot == team.name:
                    continue
                known, name, _ = best.get(kept.robot, (-1, '', None))
                if (-kept.known, owner) < (-known, name):
                    best[kept.robot] = kept.known, owner, kept
        self.sources = {}
        for robot, (known, owner, kept) in best.items():
            if owner != team.name:
                team.hear(robot, kept.edges)
                if robot not in mine or known > mine[robot].known:
                    self.sources[robot] = owner
        self.kept = tuple(Kept(robot, mine[robot].known, team.heard_of(robot))
                          for robot in sorted(mine))

    def maps(self) -> Mapping[str, SharedMap]:
        """Give the maps of the absent robots, by name."""
        return {kept.robot: self._team.maps[kept.robot] for kept in self.kept}

    def _known(self, robot: str) -> int:
        """Count the known cells of a robot's map, once per map."""
        shared = self._team.maps[robot]
        if self._counted.get(robot, (None, 0))[0] is not shared:
            self._counted[robot] = shared, int(np.count_nonzero(shared.grid.known))
        return self._counted[robot][1]
