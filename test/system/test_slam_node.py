# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""slam_node as a process on a real middleware, driven through a room whose walls are known."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from helpers import need_ros, pose_error, ros_environment, write_fake_bag
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.map_change import missing_walls

need_ros()

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402, I100
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped  # noqa: E402
from live_robot import (BEAMS, GIVEN_MOUNT, OTHER_ROUND, RADIUS, Robot, ROUND,  # noqa: E402
                        SEPARATION)
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry  # noqa: E402
from nav_msgs.msg import Path as PathMessage  # noqa: E402
from nav_msgs.srv import GetMap  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from somfusion_ros.io.bags.log import open_log  # noqa: E402
from somfusion_ros.io.maps import read_map  # noqa: E402
from somfusion_ros.offline.robot_run import run_robot  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from somfusion_ros.slam.checkpoint_file import load_checkpoint  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

pytestmark = pytest.mark.system


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def grid(message: OccupancyGrid) -> Grid:
    """Convert a map that must be good."""
    return convert.grid_from_message(message, 10 ** 7)


def values_of(messages: list[DiagnosticArray]) -> dict[str, str]:
    """Read the newest diagnostics."""
    return {v.key: v.value for v in messages[-1].status[0].values} if messages else {}


def test_a_room_is_mapped_and_every_interface_serves(graph: Graph, tmp_path: Path) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    paths = graph.hear(PathMessage, '/robot1/path', qos.LATEST)
    metadata = graph.hear(MapMetaData, '/robot1/map_metadata', qos.LATCHED)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.start('-p', f'map_directory:={tmp_path}')
    robot.drive(len(robot.stamps))
    robot.assert_on_course()
    covariance = convert.planar_covariance(robot.poses[-1].pose.covariance)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert robot.poses[-1].header.frame_id == 'map'

    graph.until(lambda: robot.maps and robot.maps[-1].header.stamp == robot.poses[-1].header.stamp,
                'the last map')
    drawn, true = grid(robot.maps[-1]), robot.true_map()
    assert missing_walls(drawn, true) < 0.1    # nearly no wall that is not there
    assert missing_walls(true, drawn) < 0.35   # and few that are missing, as seen from one round
    graph.until(lambda: paths and len(paths[-1].poses) >= 10, 'path')
    graph.until(lambda: metadata[-1].width == robot.maps[-1].info.width,   # they come one by one
                'metadata of the last map')
    graph.until(lambda: values_of(diagnostics).get('views'), 'diagnostics')
    values = values_of(diagnostics)
    assert {'scans_per_s', 'ms_per_scan', 'age_of_odometry_s', 'pose_sigma_x_m', 'views',
            'matches_accepted'} <= values.keys()

    graph.until(lambda: np.array_equal(   # a loop closed late draws the map once more
        grid(graph.call(GetMap, '/robot1/dynamic_map').map).evidence,
        grid(robot.maps[-1]).evidence), 'the same map by topic and service')
    saved = graph.call(Trigger, '/robot1/slam_node/save_map')
    assert saved.success, saved.message
    assert str(tmp_path / 'robot1_map.yaml') in saved.message
    assert missing_walls(read_map(tmp_path / 'robot1_map.yaml'), true) < 0.1
    assert graph.call(Trigger, '/robot1/slam_node/reset').success
    graph.assert_clean(graph.processes.stop())


def test_wheel_encoders_serve_as_odometry(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    robot.start('-p', 'odometry_source:=encoders', '-p', f'wheel_radius:={RADIUS}',
                '-p', f'wheel_separation:={SEPARATION}')
    robot.drive(120)
    robot.assert_on_course()
    graph.assert_clean(graph.processes.stop())


def test_bad_input_is_counted_and_the_drive_goes_on(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.start()
    robot.drive(30)
    nan, inf = float('nan'), float('inf')
    spoiled = [[], [nan] * BEAMS, [inf] * BEAMS, [-inf] * BEAMS, [0.0] * BEAMS, [nan], [1e30] * 9]
    for n, ranges in enumerate(spoiled):
        robot.publish(29, ranges, robot.stamps[29] + 0.001 * (n + 1))
    for stamp in (0.0, 1.0, robot.stamps[29], robot.stamps[5], 2e9):
        robot.publish(29, stamp=stamp)
    odometry = Odometry()
    odometry.pose.pose.position.x = nan
    robot._odom.publish(odometry)
    odometry.pose.pose.position.x = 0.0
    odometry.header.stamp = convert.time_message(2e9)
    robot._odom.publish(odometry)
    robot.drive(90)
    robot.assert_on_course()
    graph.until(lambda: {'odometry_not_finite', 'scan_stamps_stray', 'odometry_stamps_stray',
                         'scan_empty'} <= values_of(diagnostics).keys(), 'faults counted')
    graph.assert_clean(graph.processes.stop())


def test_time_set_back_does_not_stop_a_robot(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    robot.start()
    robot.drive(40)
    robot.stamps = robot.stamps - 9.0
    heard = len(robot.poses)
    for i in range(40, 80):
        robot.publish_odometry(i)
        robot.publish(i)
    graph.until(lambda: len(robot.poses) > heard + 25, 'poses after the jump')
    graph.until(lambda: robot.last_stamp() >= robot.stamps[79] - 0.11, 'the last scan')
    robot.assert_on_course()
    graph.assert_clean(graph.processes.stop())


def test_parameters_change_while_the_node_runs_or_say_why_not(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    robot.start()
    robot.drive(60)
    graph.until(lambda: robot.maps, 'a map')

    def change(name: str, value: float) -> Any:
        made = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[made])
        return graph.call(SetParameters, '/robot1/slam_node/set_parameters', request).results[0]
    assert change('resolution', 0.1).successful
    for name, value, words in (('resolution', 9.0, 'resolution'),
                               ('wheel_radius', 0.2, 'wheel_radius')):
        refused = change(name, value)
        assert not refused.successful
        assert words in refused.reason
    assert change('minimum_travel_distance', 1.0).successful
    robot.drive(100)
    graph.until(lambda: robot.maps[-1].info.resolution == pytest.approx(0.1), 'a coarser map')
    assert missing_walls(grid(robot.maps[-1]), robot.true_map()) < 0.1
    graph.assert_clean(graph.processes.stop())


@pytest.mark.parametrize(('given', 'words'), [
    ('resolution:=-1.0', 'resolution'), ('resolution:=fine', 'resolution'),
    ('laser_pose:=[1.0]', 'laser_pose'), ('odometry_source:=gps', 'odometry_source')])
def test_a_wrong_parameter_is_one_sentence_and_status_1(given: str, words: str) -> None:
    ended = subprocess.run([sys.executable, '-m', 'somfusion_ros.ros.slam_node', '--ros-args',
                            '-p', given], env=ros_environment(), capture_output=True, text=True,
                           timeout=60)
    assert ended.returncode == 1
    assert words in ended.stderr
    assert 'Traceback' not in ended.stderr


def test_a_robot_that_is_killed_goes_on_with_its_map(graph: Graph, tmp_path: Path) -> None:
    kept = ('-p', f'state_file:={tmp_path}/state/robot1.npz', '-p', 'state_interval:=0.1')
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.start(*kept)
    robot.drive(120)
    before = robot.settle()
    state = tmp_path / 'state' / 'robot1.npz'
    graph.until(lambda: state.exists() and load_checkpoint(state).trail[-1, 0]
                >= robot.last_stamp() - 0.01, 'the last scan in the state')
    graph.processes.kill('slam robot1')

    del robot.maps[:]
    robot.launch(*GIVEN_MOUNT, *kept)
    graph.until(lambda: robot.maps, 'the map before any scan')
    again = grid(robot.maps[-1])
    assert missing_walls(before, again) < 0.02
    assert missing_walls(again, before) < 0.02
    robot.drive_until_heard()
    robot.drive(180)
    robot.assert_on_course()
    # With those of the state; the last message may still be the killed node's.
    graph.until(lambda: int(values_of(diagnostics)['views']) > 15, 'the views of both nodes')
    assert missing_walls(grid(robot.maps[-1]), robot.true_map()) < 0.1
    graph.assert_clean(graph.processes.stop())


def test_a_damaged_state_is_put_aside_and_said(graph: Graph, tmp_path: Path) -> None:
    path = tmp_path / 'state.npz'
    path.write_bytes(b'this is no state')
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.start('-p', f'state_file:={path}')
    robot.drive(30)
    robot.assert_on_course()
    graph.until(lambda: 'state_unusable' in values_of(diagnostics), 'the named fault')
    assert (tmp_path / 'state.npz.bad').read_bytes() == b'this is no state'
    graph.assert_clean(graph.processes.stop())
    assert path.exists()   # written anew at the end


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_signal_in_the_middle_of_work_ends_it_cleanly(number: int, graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    pid: list[int] = []
    launch = graph.processes.start
    graph.processes.start = lambda *given: pid.append(launch(*given))
    robot.start('-p', 'map_update_interval:=0.1')
    for i in range(1, 100):   # more than it can have done when the signal comes
        robot.publish_odometry(i)
        robot.publish(i)
    os.kill(pid[0], number)
    name = 'slam robot1'
    ended = graph.until(lambda: name in graph.processes.statuses and graph.processes.statuses
                        or graph.processes.ended(), 'the end')
    graph.assert_clean(ended)


def test_a_played_bag_arrives_whole_and_gives_what_replay_gives(graph: Graph,
                                                                tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    write_fake_bag(bag)
    poses = graph.hear(PoseWithCovarianceStamped, '/robot1/pose', qos.REPLAY)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    graph.start('slam', 'slam_node', '/robot1', '-p', 'laser_pose:=[0.1,0.0,0.0]')
    graph.processes.start('player', 'somfusion_ros.ros.apps.player', [
        str(bag), '--rate', '4', '--ros-args', '-r', '__ns:=/robot1'])
    graph.until(lambda: 'player' in graph.processes.ended(), 'the end of the bag')

    replayed = run_robot(open_log(bag))

    def followed() -> bool:   # the very last scan may wait in vain for odometry, here or there
        return abs(len(replayed.milliseconds) - int(values_of(diagnostics).get('scans', 0))) <= 1
    graph.until(followed, 'every scan')
    last, stamp = poses[-1], convert.seconds(poses[-1].header.stamp)
    same = int(np.argmin(np.abs(replayed.stamps - stamp)))
    assert stamp >= replayed.stamps[-1] - 0.11
    assert pose_error(convert.pose_from_message(last.pose.pose), replayed.poses[same])[0] < 0.1
    graph.assert_clean(graph.processes.statuses | graph.processes.stop())


@pytest.mark.parametrize('content', [None, b'', b'this is no bag' * 100])
def test_a_bag_that_is_none_is_said_in_one_sentence(content: bytes | None,
                                                    tmp_path: Path) -> None:
    bag = tmp_path / 'no.mcap'
    if content is not None:
        bag.write_bytes(content)
    ended = subprocess.run([sys.executable, '-m', 'somfusion_ros.ros.apps.player', str(bag)],
                           env=ros_environment(), capture_output=True, text=True, timeout=30)
    assert ended.returncode != 0
    assert 'no.mcap' in ended.stderr
    assert 'Traceback' not in ended.stderr


def test_two_robots_four_processes_one_global_map(graph: Graph) -> None:
    robots = [Robot(graph, 'robot1', ROUND), Robot(graph, 'robot2', OTHER_ROUND)]
    results: dict[str, dict[str, list[Any]]] = {}
    for robot in robots:
        graph.start(f'fusion {robot.name}', 'fusion_node', f'/{robot.name}', '-p',
                    'estimation_rate:=2.0')
        results[robot.name] = {
            'map': graph.hear(OccupancyGrid, f'/{robot.name}/global_map', qos.LATCHED),
            'transform': graph.hear(TransformStamped, f'/{robot.name}/relative_transforms',
                                    qos.LATCHED_PER_PAIR)}
        robot.start()
    for part in (0.25, 0.5, 0.75, 1.0):
        for robot in robots:
            robot.drive(int(part * len(robot.stamps)))
    frames = [Pose.from_array(robot.true_map().T_frame_grid) for robot in robots]
    truth = compose(frames[0], between(frames[1], Pose()))   # map of robot2 in that of robot1

    def right() -> bool:
        found = results['robot1']['transform'][-1:]
        return any(pose_error(convert.transform_from_message(t), truth)[0] < 0.15 for t in found)
    graph.until(right, 'the right transform')
    for name in results:
        graph.until(lambda: results[name]['map'], f'global map of {name}')
        assert results[name]['map'][-1].header.frame_id == 'world'
    graph.assert_clean(graph.processes.stop())
