# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lidar without odometry, and a gyroscope beside it, on simulated drives with truth."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from somfusion_ros.geometry import Array
from somfusion_ros.io.bags.odometry import turn_rate
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import office
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import SICK, simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import increment_covariance, MotionNoise
from somfusion_ros.slam.motion_guess import MotionGuess, TurnRate
from somfusion_ros.slam.session import Session

pytestmark = pytest.mark.slow


def driven(laser: Laser) -> Trial:
    """Drive through the office, in and out of rooms."""
    route = office().route(2)[:7]
    stamps, poses = drive.follow(route, 1.6, 0.5, 1000.0)
    return simulate_trial(lambda t: Scene(office().segments), stamps, poses, laser,
                          np.random.default_rng(0))


def error(trial: Trial, gyro: float = 0.0, bias: float = 0.0, wheels: Array | None = None
          ) -> tuple[float, Counter[str]]:
    """
    Largest error [m] of the trajectory, and what was counted; all scans must be used.

    gyro: factor of the turn rate that an Imu tells, 0 without one; wheels: odometry (M, 3).
    """
    counts: Counter[str] = Counter()
    session = Session(SlamConfig(), 1.0, lambda kind, reason='': counts.update([kind]),
                      background=False, odometry=wheels is not None)
    if gyro:
        for stamp, rate in zip(trial.stamps[1:], np.diff(np.unwrap(trial.poses[:, 2]))
                               / drive.STEP):
            session.add_turn_rate(float(stamp), gyro * (float(rate) + bias))
    if wheels is not None:
        for told in zip(trial.odometry_stamps, wheels, strict=True):
            session.add_odometry(*told)
    used = 0
    for scan in trial.scans:
        session.add_scan(scan, None, 0.0)
        used += sum(step.accepted for _, step in session.steps(0.0))
    used += sum(step.accepted for _, step in session.finish())
    assert used >= len(trial.scans) - 1
    stamps, poses = session.slam.trajectory()
    return float(np.hypot(*(poses - trial.truth(stamps))[:, :2].T).max()), counts


@pytest.mark.parametrize('laser', [SICK, replace(Laser(), turn=0.0)])
def test_a_lidar_alone_is_followed(laser: Laser) -> None:
    assert error(driven(laser))[0] < 0.2


@pytest.mark.parametrize('bias', [0.0, 0.02])
def test_a_gyroscope_carries_turns_between_slow_scans(bias: float) -> None:
    """A scan a second, while the robot turns at up to 1 rad/s; the bias is 1.1 deg/s."""
    trial = driven(replace(SICK, period=1.0))
    assert error(trial, gyro=1.0, bias=bias)[0] < 0.2


@pytest.mark.parametrize(('factor', 'counted'), [(1.0, 0), (-180.0 / np.pi, 1)])
def test_a_gyroscope_beside_wheels_carries_a_blind_robot(factor: float, counted: int) -> None:
    """A laser that sees nothing for 12 s: 0.04 m, a third of the error with wheels alone."""
    trial = driven(replace(SICK, period=0.5))
    trial = replace(trial, scans=[
        replace(scan, ranges=np.full_like(scan.ranges, np.nan)) if 20.0 < scan.stamp < 32.0
        else scan for scan in trial.scans])
    alone, _ = error(trial, wheels=trial.odometry)
    helped, counts = error(trial, gyro=factor, bias=0.02, wheels=trial.odometry)
    assert helped < min(0.04, alone / 3.0)
    assert counts['gyro_unit'] == counted


def test_a_gyroscope_that_contradicts_the_scans_is_not_used() -> None:
    trial = driven(SICK)
    wrong, counts = error(trial, gyro=5.0, wheels=trial.odometry)
    without, _ = error(trial, wheels=trial.odometry)
    assert counts['gyro_contradicts'] == 1
    assert wrong == without


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
