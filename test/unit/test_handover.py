# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Going on from another view loses nothing: along a corridor a match says nothing."""

from dataclasses import replace

from helpers import pose_error
from hypothesis import given, strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.handover import handed_over
from somfusion_ros.slam.matching import Match
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.start import Start

LENGTH, REACH = 24.0, 4.0     # [m] of a corridor without a door, and of the laser
CORRIDOR = np.concatenate([box(LENGTH / 2.0, 0.0, LENGTH, 2.2), box(0.8, -0.8, 0.4, 0.4),
                           box(LENGTH - 1.5, 0.7, 0.9, 0.6)])
SCENE = Scene(CORRIDOR)
SHORT = Laser(181, np.pi, 0.1, REACH, 0.2)
small = st.floats(-0.3, 0.3)


def along(theta: float, sigma_along: float, sigma_across: float) -> Array:
    """Return the covariance (3, 3) of a pose known otherwise along a heading than across it."""
    c, s = np.cos(theta), np.sin(theta)
    R = np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
    return R @ np.diag([sigma_along, sigma_across, 0.01]) ** 2 @ R.T


@given(st.tuples(small, small, small), st.floats(-np.pi, np.pi), st.floats(0.01, 0.5))
def test_along_a_corridor_the_pose_stays_as_it_was_expected(
        slid: tuple[float, float, float], theta: float, sigma: float) -> None:
    expected, P = np.array([1.0, 2.0, 0.3]), along(0.0, sigma, sigma)
    match = Match(expected + slid, np.linalg.inv(along(theta, 1000.0, 0.002)), 1.0, 0.01)
    pose, covariance = handed_over(match, expected, P)
    way = np.array([np.cos(theta), np.sin(theta)])
    across = np.array([-way[1], way[0]])
    assert abs((pose - expected)[:2] @ way) < 0.001            # nothing tells that it slid
    assert abs((pose - match.T_map_scan)[:2] @ across) < 0.02   # 1 in 25 of the variance, at most
    assert np.linalg.eigvalsh(P - covariance)[0] > -1e-8       # nothing known before is lost


@given(st.tuples(small, small, small))
def test_a_match_that_fixes_all_stands_alone(slid: tuple[float, float, float]) -> None:
    expected, R = np.array([1.0, 2.0, 0.3]), along(0.4, 0.02, 0.01)
    match = Match(expected + slid, np.linalg.inv(R), 1.0, 0.01)
    pose, covariance = handed_over(match, expected, along(0.0, 0.03, 0.03))
    assert np.array_equal(pose, match.T_map_scan) and np.allclose(covariance, R)


def to_and_fro(ends: list[float], seed: int) -> Trial:
    """Drive along the corridor between places [m] in it, from the first on."""
    rng = np.random.default_rng(seed)
    heading = 0.0 if ends[1] > ends[0] else np.pi
    stamps, poses = drive.follow(np.array([(x, 0.0) for x in ends]), heading, 0.6, 600.0)
    return simulate_trial(lambda t: SCENE, stamps, poses, SHORT, rng,
                          drive.real_wheels(0.02, rng))


def follow(slam: Slam, drawn: Trial, start: Array, begin: Array, later: float) -> Array:
    """Feed every other scan; return error [m], largest sigma [m] and if it is odd (n, 3)."""
    told = []
    for scan in drawn.scans[::2]:
        at = drive.at(drawn.odometry_stamps, drawn.odometry, np.array([scan.stamp]))[0]
        odometry = compose(begin, between(drawn.odometry[0], at))
        stamp = scan.stamp + later
        step = slam.process(replace(scan, stamp=stamp), Odometry(stamp, odometry, np.zeros(3)))
        truth = compose(start, drawn.truth(np.array([scan.stamp]))[0])
        sigma = np.sqrt(np.linalg.eigvalsh(step.covariance[:2, :2])[-1])
        told.append((pose_error(step.pose, truth)[0], sigma, step.reason != ''))
    return np.array(told)


@pytest.mark.slow
def test_a_robot_is_tracked_to_and_fro_in_a_corridor_that_is_known() -> None:
    """Seen from another view, the way along it was lost: sigmas of 1000 m, errors of 16 m."""
    slam, there = Slam(SlamConfig(max_laser_range=REACH)), to_and_fro([1.0, LENGTH - 1.0], 1)
    follow(slam, there, np.zeros(3), np.zeros(3), 0.0)
    again = Slam(SlamConfig(max_laser_range=REACH), checkpoint=slam.checkpoint(),
                 start=Start(localization=True))
    turned = compose(between(there.odometry[0], there.odometry[-1]), np.array([0.0, 0.0, np.pi]))
    back = to_and_fro([LENGTH - 1.0, 8.0, 16.0, 8.0, 16.0, 8.0], 2)
    end = np.array([LENGTH - 2.0, 0.0, np.pi])
    error, sigma, odd = follow(again, back, end, turned, 1000.0).T
    assert not odd[1:].any()                  # the first scan is not yet known to be here
    assert error[1:].max() < 1.0              # of which the map itself is off by .4 m
    assert sigma[5:].max() < 0.5
