# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the team knows of robots that are gone, for those who come later.

A robot that left, died or is out of reach has mapped something and joined maps. Who knew it tells
the others so, and hands its map on when asked. Not all heard the same last: of words that it
sealed with one key the newest counts, however few say it, and what it did not seal does not count
any more. Otherwise, where the words differ on which map it had, the one that most robots name
counts; who knew it itself believes no single other, and no words that contradict what it heard,
unless more robots say them. Of those who knew that map, the one that knows most of it counts, then
the one whose name sorts first, so that all agree. A robot of whose map nothing is left is
forgotten.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from somfusion_ros.team.last_words import (agreed, alike, DepartedRobot, renewed, Said, same_word,
                                           Words)
from somfusion_ros.team.members import Team
from somfusion_ros.team.seal import Seal, SealChecks
from somfusion_ros.team.shared_map import SharedMap

MOST_ABSENT = 64    # robots that are remembered; of those whose map is here the first by name


class DepartedRobots:
    """
    What one robot knows of absent ones, and what its peers say about theirs.

    known is what to tell the others; sources names the peer from which to get the map of an absent
    robot, by the absent one's name; lies: who says now what cannot be, each with a sentence.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        self._offers: dict[str, tuple[DepartedRobot, ...]] = {}
        self._seals: dict[str, Seal | None] = {}
        self._unlike: set[tuple[str, str]] = set()    # robots, and who lends other maps of them
        self._checks = SealChecks()
        self._remembered: dict[str, tuple[Any, DepartedRobot]] = {}
        self._held: dict[tuple[str, str], tuple[DepartedRobot, bool | None]] = {}
        self._compared: dict[tuple[str, str], tuple[Words, Words, bool]] = {}
        self.known: tuple[DepartedRobot, ...] = ()
        self.sources: dict[str, str] = {}
        self.lies: dict[str, str] = {}

    def hear(self, owner: str, departed: tuple[DepartedRobot, ...],
             seal: Seal | None = None) -> None:
        """Replace what a peer knows of absent robots, and its seal under its own words."""
        self._offers[owner] = departed
        before = self._seals.get(owner)
        self._seals[owner] = seal or (before and before.empty())

    def forget(self, owner: str) -> None:
        """Forget what a peer said of others, which is heard no more."""
        self._offers.pop(owner, None)

    def refuse(self, robot: str) -> None:
        """Note that the map of an absent robot which was lent is not like its own."""
        if robot in self.sources:
            self._unlike.add((robot, self.sources[robot]))

    def update(self, present: Collection[str]) -> list[tuple[str, str]]:
        """
        Agree with the peers that are present on what is left of those that are not.

        Return who says what cannot be, each with a sentence, where that is new.
        """
        team, before = self._team, dict(self.lies)
        self._checks.begin()
        mine = {robot: self._mine(robot)
                for robot in sorted(team.maps.keys() - {*present, team.name})}
        self.sources, self.lies = {}, {}
        words = self._words(mine, present)
        team.absent = frozenset(words)
        for robot, said in words.items():
            believed = self._believed(renewed(self._checked(said)))
            if not believed:
                continue
            owner, gone = agreed(believed, team.name)
            own = self._own(believed)
            word = own if own is not None and own.epoch == gone.epoch else gone
            if robot not in mine or not same_word(word, mine[robot]):
                team.begin(robot, word.epoch)
                team.hear(robot, word.constraints)
                self._seals[robot] = word.seal
            if owner != team.name and (robot not in team.maps
                                       or gone.known > mine[robot].known):
                self.sources[robot] = owner
        for robot in team.epochs.keys() - {*present, *words, team.name}:
            team.forget(robot)
        self.known = tuple(self._mine(robot) for robot in sorted(mine.keys() & team.maps.keys()))
        self._prune()
        return sorted(self.lies.items() - before.items())

    def maps(self) -> Mapping[str, SharedMap]:
        """Return the maps of the absent robots, by name."""
        return {gone.robot: self._team.maps[gone.robot] for gone in self.known}

    def _mine(self, robot: str) -> DepartedRobot:
        """Say what the robot itself knows of an absent one; what that did not seal is gone."""
        team, seal = self._team, self._seals.get(robot)
        heard, epoch, shared = team.heard_of(robot), team.epochs[robot], team.maps[robot]
        counts = [team.counts(one) for one in heard]
        key = heard, counts, epoch, shared, seal
        if robot not in self._remembered or self._remembered[robot][0] != key:
            if seal is None or not self._checks.hold(seal, robot, epoch, heard):
                seal, heard = seal and seal.empty(), ()
                team.hear(robot, heard)
            order = sorted(range(len(heard)), key=lambda k: not counts[k])   # first what counts
            self._remembered[robot] = key, DepartedRobot(
                robot, int(np.count_nonzero(shared.grid.known)),
                tuple(heard[k] for k in order), epoch, seal)
        return self._remembered[robot][1]

    def _words(self, mine: Mapping[str, DepartedRobot], present: Collection[str],
               ) -> dict[str, Said]:
        """Collect who says what of every absent robot, by its name."""
        words = {robot: [(self._team.name, gone)] for robot, gone in mine.items()}
        for owner in sorted({*present} & self._offers.keys()):
            for gone in self._offers[owner]:
                if (gone.robot, owner) in self._unlike:
                    self.lies[owner] = (f'{owner} lends a map of {gone.robot}, which is gone, '
                                        'that is unlike what it told itself')
                elif gone.robot not in present and gone.robot != self._team.name and gone.known:
                    words.setdefault(gone.robot, []).append((owner, gone))
        most = sorted(words, key=lambda robot: (robot not in mine, robot))[:MOST_ABSENT]
        return {robot: words[robot] for robot in most}

    def _own(self, said: Said) -> DepartedRobot | None:
        """Return the own word among those of all."""
        return next((gone for owner, gone in said if owner == self._team.name), None)

    def _checked(self, said: Said) -> Said:
        """Leave out what a robot did not seal, though others say so."""
        own = self._own(said)
        return [(owner, gone if gone.seal else replace(gone, constraints=()))
                for owner, gone in said if gone.seal is None or (own and same_word(gone, own))
                or self._holds(owner, gone)]

    def _holds(self, owner: str, gone: DepartedRobot) -> bool:
        """Return whether a robot sealed what a peer says of it; note who makes it up."""
        asked, held = self._held.get((gone.robot, owner), (None, None))
        if asked is not gone or held is None:
            assert gone.seal is not None
            held = self._checks.hold(gone.seal, gone.robot, gone.epoch, gone.constraints, owner)
            self._held[gone.robot, owner] = gone, held
        if held is False:
            self.lies[owner] = (f'{owner} says of {gone.robot}, which is gone, what that did not '
                                'seal')
        return bool(held)

    def _believed(self, said: Said) -> Said:
        """
        Leave out words on a robot that contradict what is known here of the same map.

        Where more others agree on something else, what is known here is left out instead: of a
        robot that is gone not all heard the same last.
        """
        own = self._own(said)
        against = [word for word in said if self._contradicts(own, *word)]
        kept = [word for word in said if word not in against]
        if own is None or not against:
            return kept
        with_own = [word for word in kept if word[1].epoch == own.epoch]
        most = max(([other for other in against
                     if alike(one[1].constraints, other[1].constraints)]
                    for one in against), key=len)
        if len(most) > len(with_own):
            return [word for word in kept if word not in with_own] + most
        return kept

    def _contradicts(self, own: DepartedRobot | None, owner: str, gone: DepartedRobot) -> bool:
        """Return whether a word on a robot contradicts what is known here; note who says so."""
        if own is None or owner == self._team.name or gone.epoch != own.epoch or (
                own.seal and not (gone.constraints and own.constraints)):
            return False
        if not own.seal:     # what it never sealed nobody can know better
            return bool(gone.seal)
        asked = self._compared.get((own.robot, owner), ((), (), True))
        if asked[0] is not own.constraints or asked[1] is not gone.constraints:
            asked = (own.constraints, gone.constraints,
                     alike(own.constraints, gone.constraints))
            self._compared[own.robot, owner] = asked
        if not asked[2]:
            self.lies[owner] = (f'{owner} says of {own.robot}, which is gone, what contradicts '
                                'what was heard of it')
        return not asked[2]

    def _prune(self) -> None:
        """Forget what belongs to robots that are not known, or not gone, any more."""
        team, offers = self._team, self._offers
        self._seals = {name: seal for name, seal in self._seals.items() if name in team.epochs}
        self._unlike = {key for key in self._unlike if key[0] in team.absent}
        self._remembered = {name: one for name, one in self._remembered.items()
                            if name in team.absent}
        here = {(name, owner) for name in team.absent for owner in offers}
        self._held = {key: one for key, one in self._held.items() if key in here}
        self._compared = {key: one for key, one in self._compared.items() if key in here}
