# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team as one robot knows it, live: maps that arrive, verdicts of its own and of its peers.

Every robot keeps one of these. It sees to it that a pair is matched only when a map changed
enough, that robots are reached through others, and that all who know the same verdicts place
the maps alike: the graph holds exactly what goes over the wire, also for the robot's own.
Time is given in, as seconds of any steady clock.
"""

from collections.abc import Collection, Mapping

import numpy as np

from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.fusion.pair import missing_walls, Pair
from somfusion_ros.fusion.team import Edge, Solution, solve
from somfusion_ros.geometry import between, inverse, Pose
from somfusion_ros.grid import Grid

NEW_FRAME = 0.7        # a map that lost this share of its walls and
SHRUNK = 0.5           # of its known area was begun anew
WIRE_COVARIANCE = np.zeros((3, 3))   # a TransformStamped tells none; the drift of maps remains


class Team:
    """One robot's knowledge of its team."""

    def __init__(self, name: str, minimum_change: float = 0.1,
                 known_poses: Mapping[str, Pose] | None = None) -> None:
        self.name = name
        self.minimum_change = minimum_change
        self.grids: dict[str, Grid] = {}
        self.pairs: dict[str, Pair] = {}
        self._known = dict(known_poses or {})
        self._heard: dict[tuple[str, str], tuple[Pose, float]] = {}
        self._sighted: dict[str, Pose] = {}
        self._solved = Solution((), {})
        self._solved_for: tuple[set[str], dict[tuple[str, str], Pose]] | None = None

    def update_map(self, robot: str, grid: Grid) -> bool:
        """
        Take a robot's newest map; tell whether it differs from the last.

        Maps are compared for change, not for newer stamps. A map begun anew has a new frame:
        what was known about the robot's old one is forgotten.
        """
        old = self.grids.get(robot)
        if old is not None and _identical(old, grid):
            return False
        self.grids[robot] = grid
        if old is not None and begun_anew(old, grid):
            self.forget(robot)
        return True

    def forget(self, robot: str) -> None:
        """Forget every relation to a robot's map frame."""
        for peer in [robot] if robot != self.name else list(self.pairs):
            self.pairs.pop(peer, None)
            self._sighted.pop(peer, None)
        self._heard = {key: value for key, value in self._heard.items() if robot not in key}

    def peers(self) -> list[str]:
        """Robots whose map can be matched with the robot's own, the least tried first."""
        if self.name not in self.grids or self._known:
            return []
        return sorted(set(self.grids) - {self.name},
                      key=lambda peer: (self._pair(peer).attempts, peer))

    def is_due(self, peer: str, now: float) -> bool:
        """Tell whether the map of a peer, or the robot's own, changed enough for a new match."""
        return self._pair(peer).due(*self.maps(peer), now, self.minimum_change)

    def maps(self, peer: str) -> tuple[Grid, Grid]:
        """Target and source of a pair: the map of the first name is the target, on every robot."""
        first, second = sorted((self.name, peer))
        return self.grids[first], self.grids[second]

    def record(self, peer: str, alignment: Alignment, target: Grid, source: Grid,
               now: float) -> str:
        """Take in the verdict on the pair with a peer; tell in one word what became of it."""
        return self._pair(peer).record(alignment, target, source, now)

    def receive(self, owner: str, peer: str, T_owner_peer: Pose, now: float) -> None:
        """Take in what a peer accepted about its own and another robot's map."""
        if owner not in (peer, self.name):
            self._heard[owner, peer] = (T_owner_peer, now)

    def sight(self, peer: str, T_own_peer: Pose) -> None:
        """Take in a sighting of a peer, as the pose of its map frame in the robot's own."""
        if peer != self.name:
            self._sighted[peer] = T_own_peer

    def expire(self, alive: Collection[str], now: float, timeout: float) -> None:
        """Forget what living peers no longer repeat; what the silent ones said remains."""
        self._heard = {key: (pose, heard) for key, (pose, heard) in self._heard.items()
                       if key[0] not in alive or now - heard <= timeout}

    def own_transforms(self) -> dict[str, Pose]:
        """T_own_peer of the pairs that the robot itself accepted."""
        own = dict(self._sighted)
        for peer, pair in self.pairs.items():
            if pair.held is not None:
                T = pair.held.T_target_source
                own[peer] = T if self.name < peer else Pose.from_array(inverse(T))
        return own

    def solution(self) -> Solution:
        """Place every robot's map."""
        if self._known:
            return _solution_of_known(self._known, {self.name, *self.grids})
        poses = {(self.name, peer): pose for peer, pose in self.own_transforms().items()}
        poses |= {pair: pose for pair, (pose, _) in self._heard.items()}
        robots = {self.name, *self.grids, *(robot for pair in poses for robot in pair)}
        if (robots, poses) != self._solved_for:
            self._solved = solve(robots, [Edge(*pair, pose, WIRE_COVARIANCE)
                                          for pair, pose in poses.items()])
            self._solved_for = (robots, poses)
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


def _identical(first: Grid, second: Grid) -> bool:
    """Tell whether two maps hold the same."""
    return (first.resolution == second.resolution and first.T_frame_grid == second.T_frame_grid
            and np.array_equal(first.evidence, second.evidence))


def _solution_of_known(known: Mapping[str, Pose], robots: Collection[str]) -> Solution:
    """Place the maps by poses that the user gave."""
    anchor = min(set(known) & set(robots), default=min(known))
    edges = [Edge(anchor, robot, Pose.from_array(between(known[anchor], pose)), WIRE_COVARIANCE)
             for robot, pose in known.items() if robot in robots and robot != anchor]
    return solve({*robots, anchor}, edges)
