# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team as one robot knows it, live: maps that arrive, verdicts of its own and of its peers.

Every robot keeps one of these. It sees to it that a pair is matched only when a map changed
enough, that robots are reached through others, and that all who know the same constraints place
the maps alike: the graph holds exactly what goes over the wire, also for the robot's own. What is
said of a map counts while the map's epoch lives, and not a moment longer.
Time is handed in, as seconds of any steady clock.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.known_poses import KnownPoses
from somfusion_ros.team.map_change import missing_walls
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.pair_history import PairHistory
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.voices import newest, seen_elsewhere, SIGHTINGS


@dataclass(frozen=True)
class TeamTuning:
    """When a peer's map is shown."""

    unlike: float = tuned(
        0.5, '', 'share of walls gone from which a map is shown only once it is matched: it may '
        'be that of another building', 'not measured')


TUNING = TeamTuning()


class Team:
    """
    One robot's knowledge of its team.

    epochs: which map every robot has now, or had last; absent: who is gone; begun: how many maps
    each began after its first; maps: the newest; shown: those to draw; known: the user's word.
    """

    def __init__(self, name: str, minimum_change: float = 0.1,
                 known_poses: Mapping[str, Pose] | None = None,
                 matchers: Matchers = Matchers()) -> None:
        self.name, self._matchers = name, matchers
        self.minimum_change = minimum_change
        self.epochs: dict[str, Epoch] = {}
        self.absent: frozenset[str] = frozenset()
        self.begun: Counter[str] = Counter()
        self.maps: dict[str, SharedMap] = {}
        self.shown: dict[str, SharedMap] = {}
        self.pairs: dict[str, PairHistory] = {}
        self.known = KnownPoses(known_poses or {})
        self._heard: dict[str, tuple[MapConstraint, ...]] = {}
        self._sighted: dict[str, deque[MapConstraint]] = {}
        self._solved = Solution((), {})
        self._solved_for: Any = None

    def begin(self, robot: str, epoch: Epoch, keep_map: bool = False) -> bool:
        """
        Note which map a robot has now; return whether it began another one.

        All that was known of its former map is forgotten, and the map unless it is kept: a plain
        SLAM's first map may come before the word that it is new. Of one that went back pairs are
        matched anew, and hold until then, unless it goes back again before.
        """
        old = self.epochs.get(robot)
        self.epochs[robot] = epoch
        self.known.bind(robot, epoch)
        if old is None or old == epoch:
            return False
        self.begun[robot] += 1
        back = old.same_map(epoch)
        self._forget_constraints(robot, back)
        if not back:
            self.shown.pop(robot, None)
        if not keep_map:
            self.maps.pop(robot, None)
        elif robot in self.maps:
            self.shown[robot] = self.maps[robot]
        return True

    def forget(self, robot: str) -> None:
        """Forget a robot: its map, its words, and all that is known about both."""
        self._forget_constraints(robot)
        for record in (self.epochs, self.begun, self.maps, self.shown, self._heard):
            record.pop(robot, None)

    def counts(self, constraint: MapConstraint) -> bool:
        """
        Return whether a constraint joins the maps that two known robots have now.

        A robot is known by its own word while it is there, and by its map when it is gone: one
        that others only tell of is nobody.
        """
        return all(self.epochs.get(robot) == epoch
                   and (robot in self.maps or robot not in self.absent)
                   for robot, epoch in zip(constraint.robots, constraint.epochs))

    def update_map(self, robot: str, new: SharedMap, lent: bool = False) -> bool:
        """
        Update a robot's map; return whether it differs from the last.

        ValueError where others lend one that is unlike what it told itself. Maps are compared for
        change, not for newer stamps. A peer's map that hardly resembles the
        one that its accepted pose was found with is not shown before it is matched.
        """
        if robot not in self.epochs:
            self.begin(robot, Epoch())
        old = self.maps.get(robot)
        if old is not None and old.same_as(new):
            return False
        if lent and old is not None and missing_walls(old.grid, new.grid) > TUNING.unlike:
            raise ValueError('what others lend of it is unlike what it told itself')
        self.maps[robot] = new
        pair = self.pairs.get(robot)
        if (pair is None or pair.held is None or robot not in self.shown
                or missing_walls(self.shown[robot].grid, new.grid) <= TUNING.unlike):
            self.shown[robot] = new
        return True

    def peers(self) -> list[str]:
        """Return robots whose map can be matched with the robot's own, the least tried first."""
        if self.name not in self.maps:
            return []
        known = self.known.holding(self.epochs)
        return sorted(self.maps.keys() - {self.name, *(known if self.name in known else ())},
                      key=lambda peer: (self._pair(peer).attempts, peer))

    def is_due(self, peer: str, now: float) -> bool:
        """Return whether the map of a peer, or the robot's own, changed enough for a new match."""
        return self._pair(peer).due(*self.grids_of(peer), now, self.minimum_change)

    def grids_of(self, peer: str) -> tuple[Grid, Grid]:
        """Return target and source of a pair: on every robot, the first name is the target."""
        first, second = sorted((self.name, peer))
        return self.maps[first].grid, self.maps[second].grid

    def record(self, peer: str, alignment: Alignment, target: Grid, source: Grid,
               now: float, impossible: bool = False) -> str:
        """Record a verdict, or that its pose cannot be; return in one word what became of it."""
        pair = self._pair(peer)
        word = pair.record(alignment, target, source, now, impossible)
        if not pair.doubted and self.maps[peer].grid in (target, source):
            self.shown[peer] = self.maps[peer]
        return word

    def hear(self, owner: str, constraints: Iterable[MapConstraint]) -> None:
        """
        Replace all that a peer accepts about its own map; what it no longer says goes.

        It has one voice per pair, so that saying a thing twice does not outweigh the others.
        """
        if owner != self.name:
            self._heard[owner] = newest(
                replace(c, author=owner) for c in constraints if owner in c.robots)

    def heard_of(self, owner: str) -> tuple[MapConstraint, ...]:
        """Return what a peer said last."""
        return self._heard.get(owner, ())

    def sight(self, constraint: MapConstraint) -> None:
        """Add a sighting of a peer, as a constraint from the robot's own map, as both are now."""
        target, source = constraint.robots
        if target == self.name != source and {target, source} <= self.epochs.keys():
            self._sighted.setdefault(source, deque(maxlen=SIGHTINGS)).append(
                self._own(constraint))

    def own_constraints(self) -> list[MapConstraint]:
        """Return what the robot itself found: accepted pairs and sightings."""
        constraints = [constraint for sighted in self._sighted.values() for constraint in sighted]
        return constraints + [self._match(peer, pair.held, pair.probability)
                              for peer, pair in self.pairs.items() if pair.held is not None]

    def accepted(self) -> set[tuple[str, str]]:
        """Return which robots accept, of the present maps, their pair with which other one."""
        said = [c for words in (self.own_constraints(), *self._heard.values()) for c in words]
        return {(c.author, other) for c in said if self.counts(c)
                for other in c.robots if other != c.author}

    def seen_elsewhere(self, peer: str, alignment: Alignment) -> bool:
        """Return whether sightings that agree contradict an accepted alignment with a peer."""
        return seen_elsewhere(self._match(peer, alignment, alignment.probability),
                              self._sighted.get(peer, ()))

    def _match(self, peer: str, found: Alignment, probability: float) -> MapConstraint:
        """Return what an accepted alignment with a peer says."""
        target, source = sorted((self.name, peer))
        P = np.triu(found.covariance) + np.triu(found.covariance, 1).T   # as it is told
        assert found.T_target_source is not None     # of an accepted one it is known
        return self._own(MapConstraint(target, source, found.T_target_source, P, probability))

    def own_transforms(self) -> dict[str, Pose]:
        """Return T_own_peer of the pairs that this robot accepted, a match before a sighting."""
        return {c.source if c.target == self.name else c.target:
                c.T_target_source if c.target == self.name
                else Pose.from_array(inverse(c.T_target_source))
                for c in self.own_constraints()}

    def solution(self) -> Solution:
        """Place every robot's map by all that counts now."""
        known = self.known.holding(self.epochs)
        constraints = self.known.constraints(self.epochs) + [
            c for c in (*self.own_constraints(), *(c for said in self._heard.values()
                                                   for c in said))
            if self.counts(c) and not {*c.robots} <= known.keys()]
        robots = {self.name, *self.maps, *(robot for c in constraints for robot in c.robots)}
        key = robots, [(*c.robots, c.author, *c.T_target_source, c.covariance.tobytes(),
                        c.probability) for c in constraints]
        if key != self._solved_for:
            self._solved = self._matchers.solve(robots, constraints)
            self._solved_for = key
        return self._solved

    def reset(self) -> None:
        """Forget all verdicts; maps stay, and known poses are those of the maps of now."""
        self.pairs.clear()
        self._heard.clear()
        self._sighted.clear()
        self.known.rebind(self.epochs)

    def _forget_constraints(self, robot: str, back: bool = False) -> None:
        """Forget what the robot itself found of a robot's map; reconsider it if it went back."""
        mine = robot == self.name
        for peer in list(self.pairs) if mine else self.pairs.keys() & {robot}:
            if not (back and self.pairs[peer].reconsider()):
                del self.pairs[peer]
        for peer in list(self._sighted) if mine else [robot]:
            self._sighted.pop(peer, None)

    def _own(self, constraint: MapConstraint) -> MapConstraint:
        """Sign a constraint, for the maps that both robots have now."""
        first, second = (self.epochs[robot] for robot in constraint.robots)
        return replace(constraint, author=self.name, epochs=(first, second))

    def _pair(self, peer: str) -> PairHistory:
        """Return the history of the pair with a peer."""
        return self.pairs.setdefault(peer, PairHistory())
