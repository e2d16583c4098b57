# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Both nodes as Nav2's lifecycle_manager drives them, and services that always answer."""

from collections.abc import Iterator
from pathlib import Path
import subprocess
import sys

from helpers import fake_grid, fake_room, need_ros, ros_environment
import pytest
from somfusion_ros.io.maps import read_map
from somfusion_ros.team.map_change import missing_walls

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from lifecycle_msgs.msg import Transition  # noqa: E402
from lifecycle_msgs.srv import ChangeState, GetState  # noqa: E402
from live_robot import GIVEN_MOUNT, Robot, ROUND  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

pytestmark = pytest.mark.system
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEAN_UP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
SLAM = '/robot1/slam_node'


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def step(graph: Graph, node: str, transition: int) -> str:
    """Take one step of the life cycle, which must succeed; return the state after it."""
    request = ChangeState.Request()
    request.transition.id = transition
    assert graph.call(ChangeState, f'{node}/change_state', request).success
    return state(graph, node)


def state(graph: Graph, node: str) -> str:
    """Ask for the state of a node."""
    return str(graph.call(GetState, f'{node}/get_state').current_state.label)


def set_parameters(graph: Graph, node: str, **values: object) -> None:
    """Change live parameters, which must succeed."""
    request = SetParameters.Request(parameters=[
        Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
    results = graph.call(SetParameters, f'{node}/set_parameters', request).results
    assert all(result.successful for result in results), results


def test_a_manager_takes_slam_node_through_its_life(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    graph.start('slam', 'slam_node', '/robot1', *GIVEN_MOUNT, '-p', 'autostart:=false', '-p',
                'map_update_interval:=0.3')
    assert state(graph, SLAM) == 'unconfigured'
    assert graph.node.count_publishers('/robot1/map') == 0
    assert step(graph, SLAM, CONFIGURE) == 'inactive'
    graph.until(lambda: graph.node.count_publishers('/robot1/map') == 1, 'the publisher of maps')
    refused = graph.call(Trigger, f'{SLAM}/save_map')
    assert (refused.success, refused.message) == (False, 'the node is not active')
    assert step(graph, SLAM, ACTIVATE) == 'active'
    robot.drive_until_heard()
    robot.drive(40)

    assert step(graph, SLAM, DEACTIVATE) == 'inactive'
    graph.until(lambda: graph.node.count_subscribers('/robot1/scan') == 0, 'no ear for scans')
    heard, maps = len(robot.poses), len(robot.maps)
    robot.publish_odometry(40)
    robot.publish(40)
    graph.spin_for(0.7)
    assert (len(robot.poses), len(robot.maps)) == (heard, maps)
    assert step(graph, SLAM, ACTIVATE) == 'active'
    robot.drive_until_heard()
    robot.drive(80)
    robot.assert_on_course()   # the map of before goes on

    assert step(graph, SLAM, DEACTIVATE) == 'inactive'
    assert step(graph, SLAM, CLEAN_UP) == 'unconfigured'
    graph.until(lambda: graph.node.count_publishers('/robot1/map') == 0, 'no publisher')
    assert step(graph, SLAM, CONFIGURE) == 'inactive'
    assert step(graph, SLAM, ACTIVATE) == 'active'
    empty = graph.call(Trigger, f'{SLAM}/save_map')
    assert not empty.success   # a new life begins without a map, and no file says otherwise
    assert 'no map to save yet' in empty.message
    step(graph, SLAM, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    graph.assert_clean(graph.processes.stop())


def test_a_manager_takes_fusion_node_through_its_life(graph: Graph) -> None:
    node, maps = '/robot1/fusion_node', graph.hear(OccupancyGrid, '/robot1/global_map',
                                                   qos.LATCHED)
    clusters = graph.hear(PointCloud2, '/robot1/clusters', qos.LATCHED)
    own = graph.node.create_publisher(OccupancyGrid, '/robot1/map', qos.LATCHED)
    own.publish(convert.grid_message(fake_grid(fake_room()), 'map', Time(sec=1)))
    graph.start('fusion', 'fusion_node', '/robot1', '-p', 'autostart:=false', '-p',
                'map_update_interval:=0.3')
    assert step(graph, node, CONFIGURE) == 'inactive'
    assert not graph.call(Trigger, f'{node}/merge').success
    for number in range(2):
        assert step(graph, node, ACTIVATE) == 'active'
        heard = len(maps)
        graph.until(lambda: len(maps) > heard, 'a global map')
        graph.until(lambda: len(clusters) > number, 'the own map told to the others, anew')
        assert step(graph, node, DEACTIVATE) == 'inactive'
    graph.until(lambda: graph.node.count_publishers('/robot1/team/state') == 0,
                'the others seeing that it went')
    heard = len(maps)
    graph.spin_for(0.7)
    assert len(maps) == heard
    assert step(graph, node, CLEAN_UP) == 'unconfigured'
    assert own
    graph.assert_clean(graph.processes.stop())


def test_a_step_that_fails_says_why_and_can_be_tried_again(graph: Graph) -> None:
    graph.start('fusion', 'fusion_node', '/robot1', '-p', 'autostart:=false', '-p',
                'robot_name:=other')
    request = ChangeState.Request()
    request.transition.id = CONFIGURE
    for _ in range(2):
        answer = graph.call(ChangeState, '/robot1/fusion_node/change_state', request)
        assert not answer.success
        assert state(graph, '/robot1/fusion_node') == 'unconfigured'
    words = graph.processes.log_path('fusion').read_text()
    assert "robot_name is 'other', but the namespace is /robot1" in words
    graph.assert_clean(graph.processes.stop())


def test_files_have_names_of_their_own_and_states_come_back(graph: Graph, tmp_path: Path) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.start('-p', f'map_directory:={tmp_path}/not/there/yet')
    robot.drive(60)
    before = robot.settle()
    saved = graph.call(Trigger, f'{SLAM}/serialize_map')
    assert saved.message.endswith(f'views saved to {tmp_path}/not/there/yet/robot1_map.npz')
    set_parameters(graph, SLAM, map_name=f'{tmp_path}/lab.yaml')
    named = graph.call(Trigger, f'{SLAM}/save_map')
    assert named.message == f'map saved to {tmp_path}/lab.yaml'
    assert missing_walls(read_map(tmp_path / 'lab.yaml'), before) < 0.01

    assert graph.call(Trigger, f'{SLAM}/reset').success
    missing = graph.call(Trigger, f'{SLAM}/deserialize_map')
    assert (missing.success, missing.message) == (False, f'{tmp_path}/lab.npz does not exist')
    set_parameters(graph, SLAM, map_name='')
    robot.drive_until_heard()   # a new map has begun
    del robot.maps[:]
    assert graph.call(Trigger, f'{SLAM}/deserialize_map').success
    graph.until(lambda: robot.maps and missing_walls(before, convert.grid_from_message(
        robot.maps[-1], 10 ** 7)) < 0.02, 'the map of the state')

    paused = SetBool.Request(data=True)
    assert graph.call(SetBool, f'{SLAM}/pause_new_measurements', paused).success
    graph.until(lambda: diagnostics and 'paused' in diagnostics[-1].status[0].message, 'a word')
    heard = len(robot.poses)
    robot.publish_odometry(60)
    robot.publish(60)
    graph.spin_for(0.5)
    assert len(robot.poses) == heard
    assert graph.call(SetBool, f'{SLAM}/pause_new_measurements').success
    robot.drive_until_heard()
    set_parameters(graph, SLAM, map_directory='/proc/no such folder')
    refused = graph.call(Trigger, f'{SLAM}/save_map')
    assert not refused.success
    assert '/proc/no such folder' in refused.message
    graph.assert_clean(graph.processes.stop())


@pytest.mark.parametrize('node', ['slam_node', 'fusion_node'])
def test_help_tells_of_every_parameter(node: str) -> None:
    ended = subprocess.run([sys.executable, '-m', f'somfusion_ros.ros.{node}', '--help'],
                           env=ros_environment(), capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.startswith(f'usage: ros2 run somfusion_ros {node}')
    assert 'map_update_interval (default 5.0)' in ended.stdout


def test_what_was_given_in_vain_is_named_at_the_start(graph: Graph) -> None:
    graph.processes.start('slam', 'somfusion_ros.ros.slam_node', [
        'resolution:=0.1', '--ros-args', '-r', '__ns:=/robot1', '-p', 'resolutoin:=0.1', '-p',
        'robot_name:=robot1'])
    words = graph.processes.log_path('slam')
    for expected in ('the argument resolution:=0.1 has no effect: parameters follow',
                     'there is no parameter resolutoin; did you mean resolution?',
                     'robot_name is a parameter of fusion_node'):
        graph.until(lambda: expected in words.read_text(), expected)
    graph.assert_clean(graph.processes.stop())
