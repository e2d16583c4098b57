# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What real SLAM sessions made of simulated drives, to be replayed: maps, poses, views over time.

On one drive the robot is taken up and put down elsewhere, and its SLAM has to find it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.drive import follow
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.step import Step
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.teller import Teller
from somfusion_ros.team.view_facts import Facts

LASER = Laser(181, np.pi, 0.1, 12.0, 0.4, mount=Pose(0.2, 0.0, 0.0), height=0.25)
MAP_EVERY = 10.0      # [s] between two maps
STEP = 0.5           # [s] between two poses
WHOLE = 60.0         # [s] in which a robot sees all of the corridor that it will


@dataclass(frozen=True, eq=False)
class Tape:
    """
    One drive of one robot, as its SLAM told it.

    place: the floor plan; T_place_map: true pose of the map's frame in it; maps with the times [s]
    since the start at which they came, what was told of the path with each, and the checkpoint
    that was kept; stamps (n,) [s] and poses (n, 3) T_map_base; lost_for [s]: how long it was not
    known where the robot was; alike_until [s]: before it the map is like that of another drive
    elsewhere in the place, and nothing can tell them apart.
    """

    place: str
    T_place_map: Pose
    map_times: tuple[float, ...]
    maps: tuple[MapCells, ...]
    facts: tuple[Facts, ...]
    kept: tuple[Checkpoint, ...]
    stamps: Array
    poses: Array
    lost_for: float = 0.0
    alike_until: float = 0.0

    def over(self, elapsed: float) -> bool:
        """Return whether the drive, and with it all that is new, is over after a time [s]."""
        return elapsed > max(float(self.stamps[-1]), self.map_times[-1])

    def come(self, elapsed: float) -> int:
        """Return how many maps have come after a time [s]."""
        return sum(time <= elapsed for time in self.map_times)

    def pose_at(self, elapsed: float) -> Pose:
        """Return the pose after a time [s]; the robot stands once its drive is over."""
        return Pose.from_array(self.poses[np.searchsorted(self.stamps, elapsed).clip(
            0, len(self.stamps) - 1)])


def record(place: str, robot: int, duration: float, seed: int, taken_at: float = np.inf) -> Tape:
    """
    Drive along a route of a floor plan for a time [s], with a real SLAM session.

    At a time [s] the robot is taken up, and put down where it was after half of it.
    """
    plan, rng = PLANS[place](), np.random.default_rng(seed)
    route = plan.route(robot)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = follow(route, heading, 0.7, duration)
    scene, k = Scene(plan.segments), int(np.searchsorted(stamps, taken_at))
    trial = simulate_trial(lambda t: scene, stamps[:k], poses[:k], LASER, rng)
    if k < len(stamps):
        again = slice(k // 2, k // 2 + len(stamps) - k)
        trial = trial.then(simulate_trial(
            lambda t: scene, stamps[:len(stamps) - k], poses[again], LASER, rng),
            between(poses[0], poses[again.start]), LASER)
    session = Session(SlamConfig(), 0.5, lambda kind, reason='': None, background=False)
    for stamp, pose, slip in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        session.add_odometry(stamp, pose, slip)
    return _replayed(session, trial, place, Pose.from_array(poses[0]))


def _replayed(session: Session, trial: Trial, place: str, T_place_map: Pose) -> Tape:
    """Run a session over a trial, and keep what it tells every few seconds."""
    times: list[float] = []
    maps: list[MapCells] = []
    facts: list[Facts] = []
    kept: list[Checkpoint] = []
    steps: list[tuple[float, Step]] = []
    teller = Teller()
    for scan in trial.scans:
        session.add_scan(scan, scan.stamp, 0.0)
        for stamp, step in session.steps(0.0):
            steps.append((stamp, step))
            if stamp >= MAP_EVERY * (len(times) + 1):
                times.append(stamp)
                maps.append(cells_of(session.slam.grid()))
                kept.append(session.slam.checkpoint())
                facts.append(teller.more(kept[-1]))
    stamps = np.array([stamp for stamp, _ in steps])
    lost = [step.reason == 'lost' for _, step in steps]
    return Tape(place, T_place_map, tuple(times), tuple(maps), tuple(facts), tuple(kept), stamps,
                np.array([step.pose for _, step in steps]),
                float(LASER.period * np.count_nonzero(lost)))


def record_all(duration: float, robots: Sequence[int] = (0, 1, 2)) -> list[Tape]:
    """
    Record robots' drives in an office, two drives elsewhere, and one that is interrupted.

    Elsewhere is a corridor whose ends look alike, to a robot and to its map: of two drives in it
    that begin at either end no map tells the difference until the last of both.
    """
    ends = (record('corridor', robot, WHOLE, 10 + robot) for robot in (0, 1))
    return [*(record('office', robot, duration, robot) for robot in robots),
            *(replace(end, alike_until=end.map_times[-1]) for end in ends),
            record('office', robots[0], duration, 97, 0.6 * duration)]


def cells_of(grid: Grid) -> MapCells:
    """Return the cells of a map, as a node publishes it."""
    return MapCells(grid.to_occupancy(), grid.resolution, grid.T_frame_grid)
