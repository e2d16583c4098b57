# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lidar without odometry, and a gyroscope beside it, on simulated drives with truth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from somfusion_ros.io.bags.odometry import turn_rate
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import office
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import SICK, simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import increment_covariance, MotionNoise
from somfusion_ros.slam.motion_guess import MotionGuess, TurnRate
from somfusion_ros.slam.session import Session


def driven(laser: Laser) -> Trial:
    """Drive through the office, in and out of rooms."""
    route = office().route(2)[:7]
    stamps, poses = drive.follow(route, 1.6, 0.5, 1000.0)
    return simulate_trial(lambda t: Scene(office().segments), stamps, poses, laser,
                          np.random.default_rng(0))


def error(trial: Trial, gyro: bool = False, bias: float = 0.0) -> float:
    """Largest error [m] of the trajectory without odometry; all scans must be used."""
    session = Session(SlamConfig(), 1.0, lambda kind, reason='': None, background=False,
                      odometry=False)
    if gyro:
        for stamp, rate in zip(trial.stamps[1:], np.diff(np.unwrap(trial.poses[:, 2]))
                               / drive.STEP):
            session.add_turn_rate(float(stamp), float(rate) + bias)
    used = 0
    for scan in trial.scans:
        session.add_scan(scan, None, 0.0)
        used += sum(step.accepted for _, step in session.steps(0.0))
    used += sum(step.accepted for _, step in session.finish())
    assert used == len(trial.scans)
    stamps, poses = session.slam.trajectory()
    return float(np.hypot(*(poses - trial.truth(stamps))[:, :2].T).max())


@pytest.mark.parametrize('laser', [SICK, replace(Laser(), turn=0.0)])
def test_a_lidar_alone_is_followed(laser: Laser) -> None:
    assert error(driven(laser)) < 0.2


@pytest.mark.parametrize('bias', [0.0, 0.02])
def test_a_gyroscope_carries_turns_between_slow_scans(bias: float) -> None:
    """A scan a second, while the robot turns at up to 1 rad/s; the bias is 1.1 deg/s."""
    trial = driven(replace(SICK, period=1.0))
    assert error(trial, gyro=True, bias=bias) < 0.2


def test_a_guess_is_honest_about_what_nobody_measured() -> None:
    """Its sigmas grow with the time between scans, sideways as well."""
    covariances = []
    for period in (0.1, 0.5):
        guess = MotionGuess()
        first, second = guess.at(0.0), guess.at(period)
        assert not second.measured
        covariances.append(increment_covariance(
            second.pose - first.pose, MotionNoise(), second.slip_since(first)))
    assert (np.diag(covariances[1]) > 4.0 * np.diag(covariances[0])).all()
    assert np.sqrt(covariances[1][1, 1]) > 0.2


def test_an_imu_tells_the_turn_rate() -> None:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    message = SimpleNamespace(header=header, angular_velocity=SimpleNamespace(z=0.5))
    assert turn_rate(message, 7.0) == TurnRate(7.0, 0.5), 'without a stamp, of its recording'
