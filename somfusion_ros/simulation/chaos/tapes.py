# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What real SLAM sessions made of simulated drives: maps and poses over time, to be replayed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.drive import follow
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from somfusion_ros.team.shared_map import MapCells

LASER = Laser(181, np.pi, 0.1, 12.0, 0.4, mount=Pose(0.2, 0.0, 0.0), height=0.25)
MAP_EVERY = 6.0      # [s] between two maps
STEP = 0.5           # [s] between two poses


@dataclass(frozen=True, eq=False)
class Tape:
    """
    One drive of one robot, as its SLAM told it.

    place: the floor plan; T_place_map: true pose of the map's frame in it; maps with the times [s]
    since the start at which they came; stamps (n,) [s] and poses (n, 3) T_map_base.
    """

    place: str
    T_place_map: Pose
    map_times: tuple[float, ...]
    maps: tuple[MapCells, ...]
    stamps: Array
    poses: Array

    def map_at(self, elapsed: float) -> MapCells | None:
        """Return the newest map after a time [s]; None before the first."""
        come = sum(time <= elapsed for time in self.map_times)
        return self.maps[come - 1] if come else None

    def pose_at(self, elapsed: float) -> Pose:
        """Return the pose after a time [s]; the robot stands once its drive is over."""
        return Pose.from_array(self.poses[np.searchsorted(self.stamps, elapsed).clip(
            0, len(self.stamps) - 1)])


def record(place: str, robot: int, duration: float, seed: int) -> Tape:
    """Drive along a route of a floor plan for a time [s], with a real SLAM session."""
    plan, rng = PLANS[place](), np.random.default_rng(seed)
    route = plan.route(robot)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = follow(route, heading, 0.7, duration)
    scene = Scene(plan.segments)
    trial = simulate_trial(lambda t: scene, stamps, poses, LASER, rng)
    session = Session(SlamConfig(), 0.5, lambda kind, reason='': None, background=False)
    for stamp, pose, slip in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        session.add_odometry(stamp, pose, slip)
    times: list[float] = []
    maps: list[MapCells] = []
    places: list[tuple[float, Pose]] = []
    for scan in trial.scans:
        session.add_scan(scan, scan.stamp, 0.0)
        for stamp, step in session.steps(0.0):
            places.append((stamp, step.pose))
            if stamp >= MAP_EVERY * (len(times) + 1):
                times.append(stamp)
                maps.append(_cells(session.slam.grid()))
    return Tape(place, Pose.from_array(poses[0]), tuple(times), tuple(maps),
                np.array([stamp for stamp, _ in places]), np.array([pose for _, pose in places]))


def record_all(duration: float, robots: Sequence[int] = (0, 1, 2),
               places: Sequence[str] = ('office', 'corridor')) -> list[Tape]:
    """Record every robot's drive in every place."""
    return [record(place, robot, duration, 10 * number + robot)
            for number, place in enumerate(places) for robot in robots]


def _cells(grid: Grid) -> MapCells:
    """Cells of a map, as a node publishes it."""
    return MapCells(grid.to_occupancy(), grid.resolution, grid.T_frame_grid)
