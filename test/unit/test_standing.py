# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that stands soon knows what is free around it: explorers and planners begin there."""

from helpers import fake_room, fake_scan
import numpy as np
import pytest
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam

ROOM, POSE, REACH = fake_room(), np.array((1.5, 1.5, 0.3)), 4.5


def stood(seconds: float, rate: float = 10.0) -> Slam:
    """Stand in a room."""
    slam = Slam(SlamConfig(max_laser_range=REACH))
    for k in range(round(seconds * rate) + 1):
        t = k / rate
        slam.process(fake_scan(ROOM, POSE, t), Odometry(t, np.zeros(3), np.zeros(3)))
    return slam


@pytest.mark.parametrize('seconds', [2.5, 20.0])
def test_what_is_around_a_robot_that_stands_is_free(seconds: float) -> None:
    """Nine tenths of a square before it, however long it stands; five scans are kept for it."""
    slam = stood(seconds)
    grid = slam.grid()
    free = grid.points(grid.free)
    ahead = (np.abs(free - (0.5, 0.0)) < 0.4).all(1)     # of a square of 0.8 m
    assert ahead.sum() * grid.resolution ** 2 > 0.9 * 0.8 ** 2
    assert len(slam.checkpoint().scans) == 5
