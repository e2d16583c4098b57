# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scan shows at a place, and what others saw there."""

from helpers import fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.slam.agreement import judge_back
from somfusion_ros.slam.scan import cloud

WALL = np.array([[2.5, 0.0, 6.0, 0.0], [7.0, -9.0, 7.0, 9.0]])     # on its own, and one behind it
SQUARES = np.column_stack([np.arange(2.55, 6.0, 0.15), np.zeros(24)])     # of the first wall
FRONT = np.column_stack([np.full(60, 7.0), np.arange(-4.5, 4.5, 0.15)])   # of the second


def judged(robot: Array, squares: Array, error: Array = np.zeros(3)) -> tuple[int, int]:
    """See both walls from a pose, and judge squares with the robot off by an error."""
    mount = Pose(0.2, 0.0, 0.0)
    seen = cloud(fake_scan(WALL, robot, beams=181, field_of_view=np.pi, range_max=30.0,
                           T_base_laser=mount), 30.0)
    return judge_back(robot + error, seen, squares)


@settings(max_examples=50, deadline=None)
@given(st.floats(-1.0, 0.5), st.floats(-0.1, 0.1), st.floats(-0.03, 0.03),
       st.sampled_from([-0.15, 0.15]))
def test_a_wall_that_is_looked_along_is_not_looked_through(x: float, y: float, turn: float,
                                                           off: float) -> None:
    """In Edmonton's hall a wall seen edge on had a robot called lost that was not."""
    robot, error = np.array([x, y, 0.0]), np.array([0.0, off, turn])
    on, against = judged(robot, SQUARES, error)
    assert against <= 1     # the end of the wall may be seen square
    front = judged(robot, FRONT, error)
    assert sum(front) > 30     # what it faces is judged as before


@settings(max_examples=50, deadline=None)
@given(st.floats(3.0, 5.0), st.floats(1.5, 3.0), st.floats(0.4, 0.8))
def test_a_wall_that_is_faced_is_looked_through_where_it_is_not(x: float, y: float,
                                                                beyond: float) -> None:
    """Squares of a wall that would stand before the one that is seen."""
    robot = np.array([x, y, -np.pi / 2.0])
    on, against = judged(robot, SQUARES + [0.0, beyond])
    assert on == 0 and against >= 5
    on, against = judged(robot, SQUARES)
    assert against == 0 and on >= 5
