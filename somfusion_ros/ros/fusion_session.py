# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The work of a fusion node on a live team: maps in, verdicts and the global map out.

Nothing here knows a message or a clock; all of it runs in one worker thread. What other threads
need is handed out as snapshots that never change.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from somfusion_ros.config import FusionConfig, FusionNodeConfig
from somfusion_ros.fusion.alignment import align, Alignment
from somfusion_ros.fusion.global_map import merge_grids
from somfusion_ros.fusion.members import Team
from somfusion_ros.fusion.team import Solution
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid

SEED = 2011   # the same on every robot, so that the same maps give the same verdict


@dataclass(frozen=True)
class Snapshot:
    """
    The team as it is known now.

    own_transforms: T_own_peer of the pairs that the robot itself accepted; solution: where all
    maps lie; verdicts: the newest alignment with each peer; words: what became of it; settled:
    the peers on whose present maps the last word is said.
    """

    own_transforms: dict[str, Pose] = field(default_factory=dict)
    solution: Solution = field(default_factory=lambda: Solution((), {}))
    verdicts: dict[str, Alignment] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    settled: frozenset[str] = frozenset()

    def world(self, robot: str) -> dict[str, Pose]:
        """T_world_map by robot of the team that a robot is connected with; {} while alone."""
        group = self.solution.group_of(robot)
        return group if len(group) > 1 else {}


class FusionSession:
    """One robot's team, its verdicts and its global map."""

    def __init__(self, name: str, config: FusionNodeConfig, fusion: FusionConfig,
                 say: Callable[[str], object]) -> None:
        known = {robot: Pose(*pose) for robot, pose in config.known_poses().items()}
        self.fusion = fusion
        self.snapshot = Snapshot()
        self._name, self._config, self._say = name, config, say
        self._team = Team(name, config.minimum_change, known if config.known_init_poses else None)
        self._looked: dict[str, float] = {}
        self._words: dict[str, str] = {}
        self._said: set[str] = set()
        self._drawn: dict[str, tuple[Grid, Pose]] = {}
        self.refresh()

    @property
    def own_grid(self) -> Grid | None:
        """The robot's own newest map."""
        return self._team.grids.get(self._name)

    def take_map(self, robot: str, grid: Grid) -> bool:
        """Take a robot's map; tell whether it changed anything."""
        return self._team.update_map(robot, grid)

    def take_transform(self, owner: str, peer: str, T_owner_peer: Pose, now: float) -> None:
        """Take what a peer accepted."""
        self._team.receive(owner, peer, T_owner_peer, now)

    def take_sighting(self, peer: str, T_own_peer: Pose) -> None:
        """Take a sighting of a peer."""
        self._team.sight(peer, T_own_peer)

    def expire(self, alive: set[str], now: float) -> None:
        """Forget what living peers no longer say."""
        self._team.expire(alive, now, self._config.peer_timeout)

    def peers(self) -> list[str]:
        """Robots whose map is known beside the robot's own."""
        return self._team.peers()

    def attempt(self, now: float, force: bool = False) -> str | None:
        """Match the one pair that is due most; return the peer's name, None if none is due."""
        period = 0.0 if force else 1.0 / self._config.estimation_rate
        peer = next((peer for peer in self._team.peers()
                     if now - self._looked.get(peer, -np.inf) >= period
                     and self._look(peer, now, force)), None)
        if peer is None:
            return None
        target, source = self._team.maps(peer)
        verdict = align(target, source, self.fusion, np.random.default_rng(SEED))
        self._words[peer] = self._team.record(peer, verdict, target, source, now)
        self._say(f'{self._name} and {peer}: {self._words[peer]}; {verdict.reason}')
        return peer

    def refresh(self) -> Snapshot:
        """Place all maps anew by what is known now."""
        solution = self._team.solution()
        for reason in {dropped.reason for dropped in solution.dropped} - self._said:
            self._said.add(reason)
            self._say(reason)
        self.snapshot = Snapshot(self._team.own_transforms(), solution, {
            peer: pair.last for peer, pair in self._team.pairs.items() if pair.last is not None},
            dict(self._words), frozenset(
                peer for peer, pair in self._team.pairs.items() if pair.settled))
        return self.snapshot

    def draw(self) -> Grid | None:
        """Draw the global map; None where it would look like the last one."""
        world = self.snapshot.world(self._name)
        if not world and self._drawn and self._name in self._team.grids:
            world = {self._name: Pose()}   # the team fell apart: do not leave the old map standing
        parts = {robot: (self._team.grids[robot], pose) for robot, pose in world.items()
                 if robot in self._team.grids}
        if not parts or self._looks_drawn(parts):
            return None
        self._drawn = parts
        return merge_grids({robot: grid for robot, (grid, _) in parts.items()},
                           {robot: pose for robot, (_, pose) in parts.items()})

    def reset(self) -> None:
        """Forget all verdicts and begin again."""
        self._team.reset()
        self._looked.clear()
        self._words.clear()
        self.refresh()

    def _look(self, peer: str, now: float, force: bool) -> bool:
        """Note that a pair is looked at, and tell whether it is due."""
        self._looked[peer] = now
        return force or self._team.is_due(peer, now)

    def _looks_drawn(self, parts: dict[str, tuple[Grid, Pose]]) -> bool:
        """Tell whether the same maps lay at the same poses when last drawn."""
        return parts.keys() == self._drawn.keys() and all(
            grid is self._drawn[robot][0] and np.allclose(pose, self._drawn[robot][1], atol=1e-4)
            for robot, (grid, pose) in parts.items())
