# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A robot that does not know where it is.

What it sees does not go into its map: a new piece of map grows apart, and is joined once the
robot is found in the old one (as in the atlas of Elvira et al. 2019).
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between, compose, compose_jacobians, inverse
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.calibration import Calibration
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.covariance import seen_turned
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.relocation import KnownMap, Placed, Relocation
from somfusion_ros.slam.restart import Resumed, went_on
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.step import Step


@dataclass(frozen=True)
class LostTuning:
    """How often a lost robot looks for itself."""

    every: int = tuned(
        2, 'views', 'between two searches; each takes a second in a large map', 'not measured')
    rarer: int = tuned(
        16, 'views', 'of the piece that make the searches one view rarer: a robot that is long '
        'lost is outside the map', 'not measured')


TUNING = LostTuning()
LEAST = 3    # views of a piece that are worth joining


@dataclass(frozen=True, eq=False)
class Found:
    """
    Where a lost robot was found.

    stamp [s] of the newest scan then, metres driven since it was lost, and T_map_piece (3,): the
    frame of what it mapped meanwhile in its map.
    """

    stamp: float
    metres: float
    T_map_piece: Array


class Lost:
    """The piece of map that a lost robot is making, and the search for it in the known map."""

    def __init__(self, config: SlamConfig, counters: Counter[str],
                 known: Callable[[], KnownMap], stood: Step | None = None,
                 calibration: Calibration | None = None, astray: bool = False) -> None:
        self.piece = SingleMap(config, counters)
        self.piece.tracker.calibration = calibration or Calibration()
        self._stood = stood                  # where it was, while it may still be there
        self.metres = 0.0                    # driven since
        self.moved = stood is None           # it is not where it was
        self._odometry: Odometry | None = None   # of the newest scan
        self._known, self._astray = known, astray
        self._relocation: Relocation | None = None
        self._mapper = Mapper(config.resolution)
        self._looked = 0                     # views at the last look

    def drive(self, odometry: Odometry) -> None:
        """Add up the way of the odometry."""
        if self._odometry is not None:
            step = between(self._odometry.pose, odometry.pose)
            self.metres += float(np.hypot(step[0], step[1]))
        self._odometry = odometry

    def went_on(self, tracker: Resumed, odometry: Odometry) -> bool:
        """Return whether its first odometry tells that it drove on while it was switched off."""
        return self._stood is not None and self._odometry is None and went_on(tracker, odometry)

    @property
    def reason(self) -> str:
        """Return why the robot is not found yet, in words."""
        return self._relocation.refusal if self._relocation else 'it has not seen enough yet'

    @property
    def due(self) -> bool:
        """Whether it has seen enough since the last look for another."""
        if self._stood is not None:
            return len(self.piece.graph.clouds) > 0
        every = max(TUNING.every, self._looked // TUNING.rarer)
        return len(self.piece.graph.clouds) >= self._looked + every

    def look(self) -> tuple[int, Placed] | None:
        """Search for the newest view; return it and its place in the map, None until found."""
        if self._relocation is None:
            self._relocation = Relocation(self._known(), self._astray)
        scans, poses = self.piece.drawn()
        clouds = list(self.piece.graph.clouds[:len(poses)])
        self._looked = len(poses)
        grid = self._mapper.render(scans, poses)
        if self._stood is not None:
            hints, self._stood = self._hints(self._stood), None
            placed = self._relocation.still_here(poses, clouds, grid, hints)
            self.moved = placed is None
        else:
            placed = self._relocation.look(poses, clouds, grid)
        return None if placed is None else (len(poses) - 1, placed)

    def _hints(self, stood: Step) -> list[Array]:
        """Return where the newest view lies, if the robot stood still, or as the odometry says."""
        assert self._odometry is not None    # a piece with views has seen a scan
        T_odom_view = compose(self._odometry.pose, inverse(self.piece.graph.trail.poses[-1]))
        return [np.array(stood.pose), compose(stood.T_map_odom, T_odom_view)]

    def join(self, known: SingleMap, view: int, placed: Placed) -> Array:
        """Go on in the known map where a view was found; return T_map_piece (3,)."""
        match, poses = placed.match, self.piece.graph.ekf.poses
        T_map_piece = compose(match.T_map_scan, inverse(poses[view]))
        if known.grows and len(poses) >= LEAST:
            known.absorb(self.piece, view, match.T_map_scan, placed.covariance)
        else:
            pose, P = self.piece.pose()
            F, _ = compose_jacobians(match.T_map_scan, between(poses[view], pose))
            known.stand(compose(T_map_piece, pose),
                        F @ placed.covariance @ F.T + seen_turned(P, -T_map_piece[2]),
                        self.piece.tracker, float(self.piece.graph.trail.stamps[-1]))
        return T_map_piece


def known_map(single: SingleMap, grid: Grid) -> KnownMap:
    """Return a map, and what was drawn of it, as it is searched for a lost robot."""
    with single.lock:
        poses, clouds = single.graph.ekf.poses.copy(), list(single.graph.clouds)
    return KnownMap(poses, clouds, grid)
