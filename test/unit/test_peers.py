# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot hears of its peers: who there is, where it was, and whether its name is its own."""

import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.ros.common.names import MAP_TYPE, STATE_TYPE, TEAM_STATE
from somfusion_ros.ros.common.peers import find_peers, robot_of
from somfusion_ros.team.channels import CHANGES, MAP, STATE
from somfusion_ros.team.heard import from_sighting, Heard, TimedPose, TRAIL_KEPT, TUNING

TOPICS = [('/robot1/map', [MAP_TYPE]), ('/robot2/map', [MAP_TYPE]),
          ('/robot2/global_map', [MAP_TYPE]), ('/robot3/local_costmap/costmap', [MAP_TYPE]),
          ('/robot4/map', ['std_msgs/msg/String']), ('/fleet/robot5/map', [MAP_TYPE]),
          ('/robot6/map_updates', [MAP_TYPE]), ('/robot7/my_map', [MAP_TYPE]),
          ('/map', [MAP_TYPE]), ('/robot8/team/state', [STATE_TYPE]),
          ('/robot8/team/map', [MAP_TYPE])]
CERTAIN = np.eye(3) * 1e-12


def test_peers_are_found_by_exact_last_name_and_type() -> None:
    topics = TOPICS[:-2]
    assert find_peers(topics, 'map', MAP_TYPE, '/robot1/map', ['']) == ['fleet/robot5', 'robot2']
    assert find_peers(topics, 'map', MAP_TYPE, '/map', []) == ['fleet/robot5', 'robot1', 'robot2']
    assert find_peers(TOPICS, TEAM_STATE, STATE_TYPE, '/robot1/team/state', []) == ['robot8']


def test_what_a_robot_shows_of_its_peers_is_no_robot() -> None:
    topics = [('/robot1/peers/robot2/map', [MAP_TYPE]), ('/peers/map', [MAP_TYPE]),
              ('/a/b/peers/robot2/map', [MAP_TYPE]), (f'/{"r" * 65}/map', [MAP_TYPE])]
    assert find_peers(topics, 'map', MAP_TYPE, '/robot1/map', []) == ['peers']


def test_only_wanted_peers_are_heard() -> None:
    assert find_peers(TOPICS, 'map', MAP_TYPE, '/robot1/map', ['/robot2', 'robot9']) == ['robot2']


def test_the_robot_of_a_map_frame() -> None:
    assert [robot_of(f) for f in ('robot2/map', '/robot2/map', 'fleet/r5/map', 'map')] == [
        'robot2', 'robot2', 'fleet/r5', '']


def at(stamp: float, pose: Pose, covariance: Array = CERTAIN) -> TimedPose:
    """Make a pose at a stamp."""
    return TimedPose(stamp, pose, covariance)


def test_a_sighting_ties_two_map_frames() -> None:
    T_a_b = Pose(4.0, -1.0, 0.8)                       # truth: map of b in map of a
    T_a_base, T_b_base = Pose(1.0, 2.0, 0.3), Pose(-2.0, 0.5, -1.0)
    seen = between(T_a_base, compose(T_a_b, T_b_base))   # what the robot a sees of b
    tied, _ = from_sighting(at(0, T_a_base), Pose.from_array(seen), CERTAIN, at(0, T_b_base))
    assert np.allclose(tied, T_a_b)
    tied, _ = from_sighting(at(0, Pose()), Pose(), CERTAIN, at(0, T_b_base))
    assert np.allclose(tied, inverse(T_b_base))


def test_the_covariance_of_a_sighting_is_that_of_many_noisy_ones() -> None:
    rng = np.random.default_rng(0)
    poses = Pose(1.0, 2.0, 0.3), Pose(3.0, 1.0, 1.0), Pose(-2.0, 0.5, -1.0)
    sigmas = np.array([(0.02, 0.03, 0.01), (0.1, 0.05, 0.04), (0.04, 0.02, 0.02)])
    P = [np.diag(sigma ** 2) for sigma in sigmas]
    own, seen, peer = poses
    T, covariance = from_sighting(at(0, own, P[0]), seen, P[1], at(0, peer, P[2]))
    noise = rng.standard_normal((20000, 3, 3)) * sigmas
    own, seen, peer = (np.array(pose) + noise[:, k] for k, pose in enumerate(poses))
    off = compose(compose(own, seen), inverse(peer)) - T
    measured = np.cov(off.T)
    assert np.allclose(covariance, measured, atol=0.05 * np.abs(measured).max())


def test_a_pose_counts_only_near_its_stamp() -> None:
    heard = Heard()
    assert heard.pose_at(1.0) is None
    heard.add_pose(at(1.0, Pose(1, 0, 0)))
    heard.add_pose(at(2.0, Pose(2, 0, 0.4)))
    assert heard.pose_at(1.75).pose == pytest.approx((1.75, 0.0, 0.3), abs=0.05)
    assert heard.pose_at(2.4).pose == Pose(2, 0, 0.4)
    assert heard.pose_at(5.0) is None
    assert heard.knows(2.0)
    assert not heard.knows(2.1)


def test_a_trail_keeps_places_not_messages() -> None:
    heard = Heard()
    for stamp in range(2000):
        heard.add_pose(at(stamp, Pose(0.01 * stamp, 0.0, 0.0)))
    assert len(heard.trail) <= min(TRAIL_KEPT, 201)
    for stamp in range(20000):
        heard.add_pose(at(stamp, Pose(float(stamp), 0.0, 0.0)))
    assert len(heard.trail) == TRAIL_KEPT


def test_a_restart_is_trusted_and_two_robots_of_one_name_are_not() -> None:
    heard = Heard()
    assert all(heard.begin(session, 0.0) for session in ('a', 'a', 'b', 'b', 'c'))
    assert not heard.begin('b', 1.0)    # it was replaced, and speaks again
    assert not heard.begin('b', 1.0 + 0.9 * TUNING.name_taken)
    assert heard.begin('b', 1.1 + TUNING.name_taken)


def test_a_map_message_is_counted_as_one() -> None:
    heard = Heard()
    for channel, size in ((STATE, 100), (MAP, 5000), (CHANGES, 70)):
        heard.hear(channel, size, 3.0)
    assert (heard.maps, heard.map_at, sum(heard.received.values())) == (2, 3.0, 5170)
