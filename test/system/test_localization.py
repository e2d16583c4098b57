# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that is put into a map that exists: by search, and by hand as in RViz."""

from collections.abc import Iterator
from pathlib import Path

from helpers import fake_grid, furnished_room, need_ros, need_tf, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.io.maps import write_map

need_ros()
need_tf()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
import live_robot  # noqa: E402
from live_robot import GIVEN_MOUNT, Robot  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from pace import pace  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

pytestmark = pytest.mark.system
WALLS = furnished_room(12.0, 9.0)
THERE = [[0.6, 0.6], [6.0, 0.6], [11.4, 0.6], [11.4, 3.0], [6.0, 3.1], [0.7, 3.2]]
WAY = np.array([*THERE, [0.6, 1.5], *THERE])   # the first round is enough on an idle machine
FRAME = Pose(3.0, -2.0, 0.7)   # of the walls in the given map
METRES, RADIANS = 0.15, np.radians(2.0)


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """Give a graph that ends with the test, and a room with things in it."""
    monkeypatch.setattr(live_robot, 'WALLS', WALLS)
    with ros_graph(tmp_path) as made:
        yield made


def place(i: int, robot: Robot) -> Array:
    """Return the true pose of the robot in the given map."""
    return compose(FRAME, robot.truth[i])


def off(robot: Robot) -> tuple[float, float]:
    """Error [m, rad] of the newest pose in the given map."""
    i = int(np.argmin(np.abs(robot.stamps - robot.last_stamp())))
    return pose_error(convert.pose_from_message(robot.poses[-1].pose.pose), place(i, robot))


def assert_placed(robot: Robot) -> None:
    """Check the newest pose in the given map."""
    metres, radians = off(robot)
    assert metres < METRES
    assert radians < RADIANS


def warning(messages: list[DiagnosticArray]) -> str:
    """Read what slam_node warns of."""
    return str(messages[-1].status[0].message) if messages else ''


def test_a_robot_finds_itself_in_a_given_map_and_leaves_it_as_it_is(graph: Graph,
                                                                    tmp_path: Path) -> None:
    robot, known = Robot(graph, 'robot1', WAY), fake_grid(WALLS, T_map_walls=FRAME)
    transforms = graph.hear(TFMessage, '/tf', qos.TRANSFORMS)
    path = write_map(tmp_path, known)
    robot.launch(*GIVEN_MOUNT, '-p', 'mode:=localization', '-p', f'map_file:={path}')
    graph.until(lambda: robot.maps, 'the given map')
    shown = robot.maps[-1]
    robot.drive_until_heard()
    assert not transforms   # nobody is told of a place before it is known
    for last in range(20, len(robot.stamps) + 20, 20):
        robot.drive(min(last, len(robot.stamps)))
        graph.spin_for(pace())   # the search needs its time, which a real drive of 2 s gives it
        if robot.poses[-1].pose.covariance[0] < 1.0:   # [m^2] it believes that it is found
            assert_placed(robot)
            break
    words = graph.processes.log_path('slam robot1')
    graph.until(lambda: 'found in the map after' in words.read_text(), 'the word of it')
    robot.drive(min(robot.sent + 40, len(robot.stamps)))
    assert_placed(robot)
    graph.until(lambda: transforms, 'map -> odom')
    heard = len(robot.maps)
    graph.until(lambda: len(robot.maps) > heard, 'the map again')
    assert (robot.maps[-1].info.width, robot.maps[-1].data) == (shown.info.width, shown.data)
    graph.assert_clean(graph.processes.stop())


def test_a_pose_by_hand_puts_the_robot_into_the_map_of_another(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', WAY)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    other = graph.node.create_publisher(OccupancyGrid, '/robot2/global_map', qos.LATCHED)
    by_hand = graph.node.create_publisher(PoseWithCovarianceStamped, '/robot1/initialpose', 1)
    robot.launch(*GIVEN_MOUNT, '-p', 'mode:=localization', '-p',
                 'map_topic:=/robot2/global_map')
    graph.until(lambda: 'no map on /robot2/global_map yet' in warning(diagnostics), 'a word')
    other.publish(convert.grid_message(fake_grid(WALLS, T_map_walls=FRAME), 'world', Time(sec=1)))
    graph.until(lambda: robot.maps, 'the given map')
    robot.drive_until_heard()
    words = graph.processes.log_path('slam robot1')
    guess = Pose.from_array(place(0, robot) + (0.2, -0.15, np.radians(8.0)))

    def give(frame: str, expected: str) -> None:
        graph.until(by_hand.get_subscription_count, 'somebody who listens')

        def heard() -> bool:   # as a user does who sees that nothing happened
            by_hand.publish(convert.pose_with_covariance(
                guess, np.diag((0.25, 0.25, 0.07)), frame, Time()))
            graph.spin_for(0.3)
            return expected in words.read_text()
        graph.until(heard, expected)
    give('world', "a pose in 'world' is not used here")
    graph.start('fusion', 'fusion_node', '/robot1')
    graph.until(lambda: by_hand.get_subscription_count() == 2, 'a translator')
    give('world', 'initialpose: the robot is taken to be at')
    robot.drive(40)
    assert_placed(robot)
    assert 'found in the map' not in words.read_text()
    graph.assert_clean(graph.processes.stop())
