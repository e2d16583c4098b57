# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team as one robot knows it, live: maps that arrive, verdicts of its own and of its peers.

Every robot keeps one of these. It sees to it that a pair is matched only when a map changed
enough, that robots are reached through others, and that all who know the same constraints place
the maps alike: the graph holds exactly what goes over the wire, also for the robot's own.
Time is handed in, as seconds of any steady clock.
"""

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import between, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.graph import Solution, solve
from somfusion_ros.team.map_change import begun_anew, missing_walls
from somfusion_ros.team.pair_history import PairHistory
from somfusion_ros.team.shared_map import SharedMap

SIGHTINGS = 5          # newest sightings of a peer that are kept
KNOWN_COVARIANCE = np.zeros((3, 3))   # of poses that the user gave; the drift of maps remains


@dataclass(frozen=True)
class TeamTuning:
    """When a peer's map is shown."""

    unlike: float = tuned(
        0.5, '', 'share of walls gone from which a map is shown only once it is matched: it may '
        'be that of another building', 'not measured')


TUNING = TeamTuning()


class Team:
    """One robot's knowledge of its team."""

    def __init__(self, name: str, minimum_change: float = 0.1,
                 known_poses: Mapping[str, Pose] | None = None) -> None:
        self.name = name
        self.minimum_change = minimum_change
        self.maps: dict[str, SharedMap] = {}
        self.shown: dict[str, SharedMap] = {}
        self.pairs: dict[str, PairHistory] = {}
        self.begun_anew: Counter[str] = Counter()
        self._known = dict(known_poses or {})
        self._heard: dict[str, tuple[MapConstraint, ...]] = {}
        self._sighted: dict[str, deque[MapConstraint]] = {}
        self._solved = Solution((), {})
        self._solved_for: Any = None

    def update_map(self, robot: str, new: SharedMap) -> bool:
        """
        Update a robot's map; return whether it differs from the last.

        Maps are compared for change, not for newer stamps. A map begun anew has a new frame:
        what was known about the robot's old one is forgotten. A peer's map that hardly resembles
        the one that its accepted pose was found with is not shown before it is matched.
        """
        old = self.maps.get(robot)
        if old is not None and old.same_as(new):
            return False
        self.maps[robot] = new
        if old is not None and begun_anew(old.grid, new.grid):
            self.begun_anew[robot] += 1
            self.forget(robot)
        pair = self.pairs.get(robot)
        if (pair is None or pair.held is None or robot not in self.shown
                or missing_walls(self.shown[robot].grid, new.grid) <= TUNING.unlike):
            self.shown[robot] = new
        return True

    def forget(self, robot: str) -> None:
        """Forget every constraint on a robot's map frame."""
        for peer in [robot] if robot != self.name else list(self.pairs):
            self.pairs.pop(peer, None)
        for peer in [robot] if robot != self.name else list(self._sighted):
            self._sighted.pop(peer, None)
        self._heard = {owner: tuple(c for c in said if robot not in c.robots)
                       for owner, said in self._heard.items()}

    def peers(self) -> list[str]:
        """Robots whose map can be matched with the robot's own, the least tried first."""
        if self.name not in self.maps or self._known:
            return []
        return sorted(set(self.maps) - {self.name},
                      key=lambda peer: (self._pair(peer).attempts, peer))

    def is_due(self, peer: str, now: float) -> bool:
        """Return whether the map of a peer, or the robot's own, changed enough for a new match."""
        return self._pair(peer).due(*self.grids_of(peer), now, self.minimum_change)

    def grids_of(self, peer: str) -> tuple[Grid, Grid]:
        """Target and source of a pair: the map of the first name is the target, on every robot."""
        first, second = sorted((self.name, peer))
        return self.maps[first].grid, self.maps[second].grid

    def record(self, peer: str, alignment: Alignment, target: Grid, source: Grid,
               now: float) -> str:
        """Record the verdict on the pair with a peer; return in one word what became of it."""
        pair = self._pair(peer)
        word = pair.record(alignment, target, source, now)
        if not pair.doubted and self.maps[peer].grid in (target, source):
            self.shown[peer] = self.maps[peer]
        return word

    def hear(self, owner: str, constraints: Iterable[MapConstraint]) -> None:
        """
        Replace all that a peer accepts about its own map; what it no longer says goes.

        It has one voice per pair, so that saying a thing twice does not outweigh the others.
        """
        if owner != self.name:
            own = [c for c in constraints if owner in c.robots]
            matches = {frozenset(c.robots): c for c in own if c.kind == 'match'}
            sightings = [c for c in own if c.kind != 'match']
            self._heard[owner] = (*matches.values(), *sightings)

    def heard_of(self, owner: str) -> tuple[MapConstraint, ...]:
        """Return what a peer said last."""
        return self._heard.get(owner, ())

    def sight(self, constraint: MapConstraint) -> None:
        """Add a sighting of a peer, as a constraint from the robot's own map."""
        if constraint.target == self.name != constraint.source:
            self._sighted.setdefault(constraint.source, deque(maxlen=SIGHTINGS)).append(constraint)

    def own_constraints(self) -> list[MapConstraint]:
        """Return what the robot itself found: accepted pairs and sightings."""
        constraints = [constraint for sighted in self._sighted.values() for constraint in sighted]
        for peer, pair in self.pairs.items():
            held = pair.held
            if held is not None and held.T_target_source is not None:
                target, source = sorted((self.name, peer))
                constraints.append(MapConstraint(target, source, held.T_target_source,
                                                 held.covariance, held.probability))
        return constraints

    def own_transforms(self) -> dict[str, Pose]:
        """T_own_peer of the pairs that the robot itself accepted, a match before a sighting."""
        return {c.source if c.target == self.name else c.target:
                c.T_target_source if c.target == self.name
                else Pose.from_array(inverse(c.T_target_source))
                for c in self.own_constraints()}

    def solution(self) -> Solution:
        """Place every robot's map."""
        if self._known:
            return _solution_of_known(self._known, {self.name, *self.maps})
        constraints = self.own_constraints() + [c for said in self._heard.values() for c in said]
        robots = {self.name, *self.maps, *(robot for c in constraints for robot in c.robots)}
        key = robots, [(*c.robots, *c.T_target_source, c.covariance.tobytes())
                       for c in constraints]
        if key != self._solved_for:
            self._solved, self._solved_for = solve(robots, constraints), key
        return self._solved

    def reset(self) -> None:
        """Forget all verdicts; maps stay."""
        self.pairs.clear()
        self._heard.clear()
        self._sighted.clear()

    def _pair(self, peer: str) -> PairHistory:
        """Return the history of the pair with a peer."""
        return self.pairs.setdefault(peer, PairHistory())


def _solution_of_known(known: Mapping[str, Pose], robots: Collection[str]) -> Solution:
    """Place the maps by poses that the user gave."""
    anchor = min(set(known) & set(robots), default=min(known))
    constraints = [MapConstraint(anchor, robot, Pose.from_array(between(known[anchor], pose)),
                                 KNOWN_COVARIANCE)
                   for robot, pose in known.items() if robot in robots and robot != anchor]
    return solve({*robots, anchor}, constraints)
