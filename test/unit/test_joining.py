# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How sure a robot is of its place once it was found, or told where it is: in which axes."""

from collections import Counter

import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose
from somfusion_ros.simulation.floor_plan import box
from somfusion_ros.simulation.raycast import raycast
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.lost import Lost
from somfusion_ros.slam.matching import Match
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.relocation import KnownMap, Placed
from somfusion_ros.slam.scan import cloud, Scan
from somfusion_ros.slam.single_map import SingleMap

P = np.diag([0.3, 0.05, 0.02]) ** 2    # of a pose in a map, in the map's axes
P[0, 1] = P[1, 0] = 0.01
TENTH = 0.1 * 0.05 ** 2                # of the least variance: what views know is on top


def turning(start: Array, turn: float, steps: int = 9) -> SingleMap:
    """Map a room from one place (3,), at which the robot turns by an angle [rad]."""
    single, angles = SingleMap(SlamConfig(), Counter()), np.radians(np.arange(360.0))
    for k, theta in enumerate(np.linspace(0.0, turn, steps)):
        pose = np.array([0.0, 0.0, theta])
        x, y, heading = compose(start, pose)
        ranges, _ = raycast(box(0.0, 0.0, 5.0, 4.0), np.tile((x, y), (360, 1)), heading + angles)
        scan = Scan(0.1 * k, ranges, 0.0, np.radians(1.0), 0.1, 10.0)
        single.follow(scan.stamp, cloud(scan, 10.0, np.zeros(3)),
                      Odometry(scan.stamp, pose, np.zeros(3)))
    return single


def test_a_robot_is_as_sure_as_it_is_told_whichever_way_old_views_look():
    known = turning(np.zeros(3), np.pi / 2.0)
    known.stand(known.pose()[0], P)
    np.testing.assert_allclose(known.pose()[1], P, atol=TENTH)


@pytest.mark.parametrize('heading', [-3.0, 0.0, 0.7, np.pi / 2.0])
def test_a_joined_piece_is_as_sure_as_its_match_whichever_way_it_looks(heading: float):
    known, place = turning(np.zeros(3), np.pi / 2.0), np.array([0.2, 0.1, heading])
    first = known.graph.ekf.n
    known.absorb(turning(place, 0.0), 0, place, P)
    np.testing.assert_allclose(known.graph.ekf.poses[first], place, atol=1e-3)
    np.testing.assert_allclose(known.graph.ekf.block(first, first), P, atol=TENTH)


@pytest.mark.parametrize('heading', [-3.0, 0.0, 0.7, np.pi / 2.0])
def test_a_robot_found_by_a_piece_too_small_to_join_is_as_sure_as_its_match(heading: float):
    """It has turned half round since, so the axes of its piece are not those of the map."""
    known, place = turning(np.zeros(3), np.pi / 2.0), np.array([0.2, 0.1, heading])
    lost = Lost(SlamConfig(), Counter(), lambda: KnownMap(*known.views(), []))
    lost.piece = turning(place, 0.8, 3)
    match = Match(place, np.linalg.inv(P), 1.0, 0.0)
    lost.join(known, 0, Placed(match, 1.0, 1.0))
    np.testing.assert_allclose(known.pose()[1], P, atol=TENTH)


def test_what_two_searches_differ_by_makes_the_pose_unsure_in_that_direction():
    """Off by 0.3 m ahead of a robot that looks along y, so it is y that is unsure."""
    match = Match(np.array([1.0, 2.0, np.pi / 2.0]), np.eye(3) * 1e6, 1.0, 0.0)
    sigma = np.sqrt(np.diag(Placed(match, 1.0, 1.0, off=np.array([0.3, 0.0, 0.0])).covariance))
    np.testing.assert_allclose(sigma, (0.0, 0.3, 0.0), atol=0.002)
