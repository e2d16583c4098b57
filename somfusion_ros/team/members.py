# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team as one robot knows it, live: maps that arrive, verdicts of its own and of its peers.

Every robot keeps one of these. It sees to it that a pair is matched only when a map changed
enough, that robots are reached through others, and that all who know the same edges place the
maps alike: the graph holds exactly what goes over the wire, also for the robot's own.
Time is given in, as seconds of any steady clock.
"""

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import between, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.graph import Edge, Solution, solve
from somfusion_ros.team.pair_history import missing_walls, Pair
from somfusion_ros.team.shared_map import SharedMap

NEW_FRAME = 0.7        # a map that lost this share of its walls and
SHRUNK = 0.5           # of its known area was begun anew
UNLIKE = 0.5           # share of walls gone from which a map is shown only once it is matched
SIGHTINGS = 5          # newest sightings of a peer that are kept
KNOWN_COVARIANCE = np.zeros((3, 3))   # of poses that the user gave; the drift of maps remains


class Team:
    """One robot's knowledge of its team."""

    def __init__(self, name: str, minimum_change: float = 0.1,
                 known_poses: Mapping[str, Pose] | None = None) -> None:
        self.name = name
        self.minimum_change = minimum_change
        self.maps: dict[str, SharedMap] = {}
        self.shown: dict[str, SharedMap] = {}
        self.pairs: dict[str, Pair] = {}
        self.begun_anew: Counter[str] = Counter()
        self._known = dict(known_poses or {})
        self._heard: dict[str, tuple[Edge, ...]] = {}
        self._sighted: dict[str, deque[Edge]] = {}
        self._solved = Solution((), {})
        self._solved_for: tuple | None = None

    def update_map(self, robot: str, new: SharedMap) -> bool:
        """
        Take a robot's newest map; tell whether it differs from the last.

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
                or missing_walls(self.shown[robot].grid, new.grid) <= UNLIKE):
            self.shown[robot] = new
        return True

    def forget(self, robot: str) -> None:
        """Forget every relation to a robot's map frame."""
        for peer in [robot] if robot != self.name else list(self.pairs):
            self.pairs.pop(peer, None)
        for peer in [robot] if robot != self.name else list(self._sighted):
            self._sighted.pop(peer, None)
        self._heard = {owner: tuple(edge for edge in edges if robot not in edge.robots)
                       for owner, edges in self._heard.items()}

    def peers(self) -> list[str]:
        """Robots whose map can be matched with the robot's own, the least tried first."""
        if self.name not in self.maps or self._known:
            return []
        return sorted(set(self.maps) - {self.name},
                      key=lambda peer: (self._pair(peer).attempts, peer))

    def is_due(self, peer: str, now: float) -> bool:
        """Tell whether the map of a peer, or the robot's own, changed enough for a new match."""
        return self._pair(peer).due(*self.grids_of(peer), now, self.minimum_change)

    def grids_of(self, peer: str) -> tuple[Grid, Grid]:
        """Target and source of a pair: the map of the first name is the target, on every robot."""
        first, second = sorted((self.name, peer))
        return self.maps[first].grid, self.maps[second].grid

    def record(self, peer: str, alignment: Alignment, target: Grid, source: Grid,
               now: float) -> str:
        """Take in the verdict on the pair with a peer; tell in one word what became of it."""
        pair = self._pair(peer)
        word = pair.record(alignment, target, source, now)
        if not pair.doubted and self.maps[peer].grid in (target, source):
            self.shown[peer] = self.maps[peer]
        return word

    def hear(self, owner: str, edges: Iterable[Edge]) -> None:
        """
        Take in all that a peer accepts now about its own map; what it no longer says goes.

        It has one voice per pair, so that saying a thing twice does not outweigh the others.
        """
        if owner != self.name:
            own = [edge for edge in edges if owner in edge.robots]
            matches = {frozenset(edge.robots): edge for edge in own if edge.kind == 'match'}
            sightings = [edge for edge in own if edge.kind != 'match']
            self._heard[owner] = (*matches.values(), *sightings)

    def heard_of(self, owner: str) -> tuple[Edge, ...]:
        """Give what a peer said last."""
        return self._heard.get(owner, ())

    def sight(self, edge: Edge) -> None:
        """Take in a sighting of a peer, as an edge from the robot's own map."""
        if edge.target == self.name != edge.source:
            self._sighted.setdefault(edge.source, deque(maxlen=SIGHTINGS)).append(edge)

    def own_edges(self) -> list[Edge]:
        """Edges that the robot itself found: accepted pairs and sightings."""
        edges = [edge for sighted in self._sighted.values() for edge in sighted]
        for peer, pair in self.pairs.items():
            if pair.held is not None:
                target, source = sorted((self.name, peer))
                edges.append(Edge(target, source, pair.held.T_target_source,
                                  pair.held.covariance, pair.held.probability))
        return edges

    def own_transforms(self) -> dict[str, Pose]:
        """T_own_peer of the pairs that the robot itself accepted, a match before a sighting."""
        return {edge.source if edge.target == self.name else edge.target:
                edge.T_target_source if edge.target == self.name
                else Pose.from_array(inverse(edge.T_target_source))
                for edge in self.own_edges()}

    def solution(self) -> Solution:
        """Place every robot's map."""
        if self._known:
            return _solution_of_known(self._known, {self.name, *self.maps})
        edges = self.own_edges() + [edge for said in self._heard.values() for edge in said]
        robots = {self.name, *self.maps, *(robot for edge in edges for robot in edge.robots)}
        key = (robots, [(*edge.robots, *edge.T_target_source, edge.covariance.tobytes())
                        for edge in edges])
        if key != self._solved_for:
            self._solved, self._solved_for = solve(robots, edges), key
        return self._solved

    def reset(self) -> None:
        """Forget all verdicts; maps stay."""
        self.pairs.clear()
        self._heard.clear()
        self._sighted.clear()

    def _pair(self, peer: str) -> Pair:
        """Give the history of the pair with a peer."""
        return self.pairs.setdefault(peer, Pair())


def begun_anew(old: Grid, new: Grid) -> bool:
    """Tell whether a robot began a new map: most walls and most of the known area are gone."""
    area = np.count_nonzero(new.known) * new.resolution ** 2
    area_before = np.count_nonzero(old.known) * old.resolution ** 2
    return bool(area < SHRUNK * area_before and missing_walls(old, new) > NEW_FRAME)


def _solution_of_known(known: Mapping[str, Pose], robots: Collection[str]) -> Solution:
    """Place the maps by poses that the user gave."""
    anchor = min(set(known) & set(robots), default=min(known))
    edges = [Edge(anchor, robot, Pose.from_array(between(known[anchor], pose)), KNOWN_COVARIANCE)
             for robot, pose in known.items() if robot in robots and robot != anchor]
    return solve({*robots, anchor}, edges)
