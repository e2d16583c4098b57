# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion between two scans, as they show it: also of a lost robot, and of no other jumps."""

from collections import Counter

from helpers import fake_scan, furnished_room
import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose
from somfusion_ros.simulation.floor_plan import box
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.start import Start

PERIOD = 0.2     # [s] of the laser


def session(counts: Counter[str], odometry: bool, checkpoint: Checkpoint | None = None) -> Session:
    """Begin a run; in the map of another, anywhere."""
    return Session(SlamConfig(), 1.0, lambda kind, reason='': counts.update([kind]), checkpoint,
                   background=False, how=Start(anywhere=True), odometry=odometry)


def drive(run: Session, walls: Array, pose: Array, step: Array, scans: range,
          odometry: Array | None = None) -> None:
    """Show scans along a way that begins at a pose (3,), and what wheels and gyroscope tell."""
    rng = np.random.default_rng(scans.start)
    for k in scans:
        stamp = 100.0 + PERIOD * k
        if odometry is not None:
            run.add_odometry(stamp, odometry)
            odometry = compose(odometry, step)
        run.add_turn_rate(stamp, step[2] / PERIOD)
        run.add_scan(fake_scan(walls, pose, stamp, noise=0.01, rng=rng), None, 0.0)
        for _ in run.steps(0.0):
            continue
        pose = compose(pose, step)


def test_a_lost_robot_without_odometry_knows_how_far_it_drove() -> None:
    """Its pose is told by nothing but its scans, and those were not listened to: 0 m."""
    walls, step, count = furnished_room(), np.array([0.15, 0.0, 0.0]), Counter[str]()
    first = session(count, odometry=False)
    drive(first, walls, np.array([1.0, 3.0, 0.0]), step, range(50))
    assert not first.slam.lost
    again = session(count, False, first.slam.checkpoint())
    drive(again, walls, np.array([3.0, 3.0, 0.0]), step, range(100, 140))
    found = again.slam.found[0]
    driven = step[0] * round((found.stamp - again.slam.driven()[0][0]) / PERIOD)
    assert found.metres == pytest.approx(driven, abs=2.0 * step[0])


@pytest.mark.parametrize('odometry', [True, False])
def test_a_pose_given_by_hand_is_no_turn(odometry: bool) -> None:
    """It was compared with what the gyroscope told, which was then not believed any more."""
    walls, count, step = box(2.5, 2.5, 5.0, 5.0), Counter[str](), np.array([0.0, 0.0, 0.05])
    run, stood, turned = session(count, odometry), np.array([2.5, 2.5, 0.0]), 10 * step
    drive(run, walls, stood, step, range(10), np.zeros(3) if odometry else None)
    run.slam.relocate(turned + (0.0, 0.0, np.pi / 2), np.diag([0.1, 0.1, 0.1]) ** 2)
    drive(run, walls, stood + turned, step, range(10, 40), turned if odometry else None)
    assert not count['gyro_contradicts']
    assert run.pairing.gyro._known
