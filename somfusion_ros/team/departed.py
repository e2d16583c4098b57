# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the team knows of robots that are gone, for those who come later.

A robot that left, died or is out of reach has mapped something and joined maps. Who knew it tells
the others so, and hands its map on when asked. Where the words differ on which map it had, the
one that most robots name counts; who knew it itself believes no single other, and no words that
contradict what it heard, unless more robots say them. Of those who knew that map, the one that
knows most of it counts, then the one whose name sorts first, so that all agree. A robot of whose
map nothing is left is forgotten.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.members import Team
from somfusion_ros.team.pair_words import agreeing
from somfusion_ros.team.shared_map import SharedMap

Words = tuple[MapConstraint, ...]
MOST_ABSENT = 64    # robots that are remembered; of those whose map is here the first by name


@dataclass(frozen=True, eq=False)
class DepartedRobot:
    """A robot that is gone, which map it had, how many cells are known, what it had accepted."""

    robot: str
    known: int
    constraints: tuple[MapConstraint, ...] = ()
    epoch: Epoch = Epoch()


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
        self._compared: dict[tuple[str, str], tuple[Words, Words, bool]] = {}
        self._lies: list[str] = []
        self.known: tuple[DepartedRobot, ...] = ()
        self.sources: dict[str, str] = {}

    def hear(self, owner: str, departed: tuple[DepartedRobot, ...]) -> None:
        """Replace what a peer knows of absent robots."""
        self._offers[owner] = departed

    def update(self, present: Collection[str]) -> list[str]:
        """
        Agree with the peers that are present on what is left of those that are not.

        Return sentences on who says what cannot be, where that is new.
        """
        team = self._team
        mine = {robot: self._mine(robot) for robot in team.maps.keys() - {*present, team.name}}
        words = self._words(mine, present)
        team.absent = frozenset(words)
        self.sources = {}
        for robot, said in words.items():
            owner, gone = _agreed(self._believed(robot, said), team.name)
            if owner != team.name:
                team.begin(robot, gone.epoch)
                team.hear(robot, gone.constraints)
                if robot not in team.maps or gone.known > mine[robot].known:
                    self.sources[robot] = owner
        for robot in team.epochs.keys() - {*present, *words, team.name}:
            team.forget(robot)
        self.known = tuple(self._mine(robot) for robot in sorted(mine.keys() & team.maps.keys()))
        lies, self._lies = self._lies, []
        return lies

    def maps(self) -> Mapping[str, SharedMap]:
        """Return the maps of the absent robots, by name."""
        return {gone.robot: self._team.maps[gone.robot] for gone in self.known}

    def _mine(self, robot: str) -> DepartedRobot:
        """Say what the robot itself knows of an absent one."""
        team = self._team
        said = sorted(team.heard_of(robot), key=team.counts, reverse=True)   # what counts first
        return DepartedRobot(robot, self._cells(robot), tuple(said), team.epochs[robot])

    def _words(self, mine: Mapping[str, DepartedRobot], present: Collection[str],
               ) -> dict[str, list[tuple[str, DepartedRobot]]]:
        """Collect who says what of every absent robot, by its name."""
        words = {robot: [(self._team.name, gone)] for robot, gone in mine.items()}
        for owner in sorted({*present} & self._offers.keys()):
            for gone in self._offers[owner]:
                if gone.robot not in present and gone.robot != self._team.name and gone.known:
                    words.setdefault(gone.robot, []).append((owner, gone))
        most = sorted(words, key=lambda robot: (robot not in mine, robot))[:MOST_ABSENT]
        return {robot: words[robot] for robot in most}

    def _believed(self, robot: str, said: list[tuple[str, DepartedRobot]]
                  ) -> list[tuple[str, DepartedRobot]]:
        """
        Leave out words on a robot that contradict what is known here of the same map.

        Where more others agree on something else, what is known here is left out instead: of a
        robot that is gone not all heard the same last.
        """
        against = [word for word in said if self._contradicts(robot, *word)]
        kept = [word for word in said if word not in against]
        with_own = [word for word in kept if word[1].epoch == self._team.epochs.get(robot)]
        if len(against) > len(with_own):
            groups = [[other for other in against if _alike(one[1].constraints,
                                                            other[1].constraints)]
                      for one in against]
            most = max(groups, key=len)
            if len(most) > len(with_own):    # of a robot whose map never came, there is none here
                return [word for word in kept if word not in with_own] + most
        return kept

    def _contradicts(self, robot: str, owner: str, gone: DepartedRobot) -> bool:
        """Return whether a word on a robot contradicts what is known here; say so once."""
        heard = self._team.heard_of(robot)
        if (owner == self._team.name or not (gone.constraints and heard)
                or gone.epoch != self._team.epochs.get(robot)):
            return False
        asked = self._compared.get((robot, owner), ((), (), True))
        if asked[0] is not heard or asked[1] is not gone.constraints:
            asked = heard, gone.constraints, _alike(heard, gone.constraints)
            self._compared[robot, owner] = asked
            if not asked[2]:
                self._lies.append(f'{owner} says of {robot}, which is gone, what '
                                  'contradicts what was heard of it')
        return not asked[2]

    def _cells(self, robot: str) -> int:
        """Count the known cells of a robot's map, once per map."""
        shared = self._team.maps[robot]
        counted = self._counted.get(robot)
        if counted is None or counted[0] is not shared:
            counted = shared, int(np.count_nonzero(shared.grid.known))
            self._counted[robot] = counted
        return counted[1]


def _alike(ones: Words, others: Words) -> bool:
    """Return whether the matches that both hold agree."""
    before, after = ({frozenset(one.robots): one for one in words if one.kind == 'match'}
                     for words in (ones, others))
    both = sorted(before.keys() & after.keys(), key=sorted)
    return not both or bool(agreeing([before[pair] for pair in both],
                                     [after[pair] for pair in both]).all())


def _agreed(said: list[tuple[str, DepartedRobot]], own: str) -> tuple[str, DepartedRobot]:
    """Choose the word that counts among those of several robots on one that is gone."""
    names = [gone.epoch for _, gone in said]
    mine = {gone.epoch for owner, gone in said if owner == own}
    epoch = max(sorted(set(names), key=str), key=lambda one: (names.count(one), one in mine))
    return min(((owner, gone) for owner, gone in said if gone.epoch == epoch),
               key=lambda word: (-word[1].known, word[0]))
