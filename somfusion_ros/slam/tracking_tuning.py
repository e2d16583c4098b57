# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When the tracker believes its odometry, and when a match."""

from dataclasses import dataclass

from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class TrackingTuning:
    """When odometry and match are believed."""

    doubt: float = tuned(
        36.0, 'squared sigmas', 'at which match and odometry disagree', 'shared logs')
    agreed: float = tuned(
        9.0, 'squared sigmas', 'at which they agree', 'shared logs')
    similar: float = tuned(
        0.05, 'share of points', 'by which a match must win over the one at the odometry',
        'mit-csail')
    sudden: float = tuned(
        0.5, 'share of the usual inlier ratio', 'below, something happened', 'mit-csail')
    typical: float = tuned(
        0.9, 'share of the usual inlier ratio',
        'above, nothing did, whatever the sigmas of the odometry say', 'intel')
    regained: float = tuned(
        0.6, 'share of the usual inlier ratio', 'by which a lost robot is found again, at least',
        'test/unit/test_relocation.py, mit-csail')
    broke: tuple[float, float] = tuned(
        (0.3, 0.3), 'm, rad', 'unless the odometry broke off the motion by more than this',
        'mit-csail')
    memory: float = tuned(
        0.2, 'weight', 'of the newest scan in the usual inlier ratio', 'not measured')
    jump_speed: tuple[float, float] = tuned(
        (4.0, 6.0), 'm/s, rad/s', 'no indoor robot drives faster: its odometry jumped',
        'by design')
    jump: float = tuned(
        50.0, 'm', 'that odometry may move between two scans, however long the pause: a longer '
        'way was not driven unseen', 'by design')
    guessed: float = tuned(
        0.3, 's', 'between two scans without odometry, from which on the pose is always sought as '
        'if the match were doubtful', 'mit-csail')
    lost_sigma: tuple[float, float, float] = tuned(
        (0.5, 0.3, 0.5), 'm, m, rad', 'added once the robot is lost', 'mit-csail')
    catch_up: float = tuned(
        3.0, 's', 'within which stalled odometry may report what it left out', 'mit-csail')
    loose: float = tuned(
        4.0, 'sigmas of the odometry', 'for the hold on a match', 'shared logs')


TUNING = TrackingTuning()
