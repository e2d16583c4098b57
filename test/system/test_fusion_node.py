# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""fusion_node as processes on a real middleware, fed with maps whose true pose is known."""

from array import array
from collections.abc import Iterator
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from helpers import (cut_grid, fake_grid, fake_room, furnished_room, need_ros, pose_error, ROOT,
                     ros_environment, write_fake_bag)
import numpy as np
import pytest
from scipy.spatial import cKDTree
from somfusion_ros.geometry import apply, between, compose, Pose
from somfusion_ros.grid import Grid

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from pace import pace  # noqa: E402
from rcl_interfaces.msg import ParameterType  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from somfusion_ros.io.maps import read_map  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

pytestmark = pytest.mark.system
# True pose of the walls in each robot's map; what two robots see overlaps, and not more.
FRAMES = {'robot1': Pose(), 'robot2': Pose(3.0, -2.0, 0.6), 'robot3': Pose(-1.0, 4.0, -2.2)}
FAST = ('-p', 'estimation_rate:=5.0', '-p', 'merging_rate:=5.0', '-p', 'discovery_rate:=5.0',
        '-p', 'plain_map_delay:=1.0')
LIMIT = 10 ** 7


WALLS = furnished_room()
METRES, RADIANS = 0.1, np.radians(1.0)


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def map_of(robot: str) -> Grid:
    """Draw a robot's map of the walls."""
    return fake_grid(WALLS, T_map_walls=FRAMES[robot])


def publish_map(graph: Graph, robot: str, grid: Grid | OccupancyGrid) -> Any:
    """Publish a map as a robot's SLAM would; the publisher keeps it for late joiners."""
    publisher = graph.node.create_publisher(OccupancyGrid, f'/{robot}/map', qos.LATCHED)
    if isinstance(grid, Grid):
        grid = convert.grid_message(grid, 'map', Time(sec=1))
    publisher.publish(grid)
    return publisher


def start(graph: Graph, robot: str, *arguments: str) -> dict[str, list[Any]]:
    """Start a robot's fusion node and listen to it."""
    graph.start(robot, 'fusion_node', f'/{robot}', *FAST, *arguments)
    return listen(graph, robot)


def listen(graph: Graph, robot: str) -> dict[str, list[Any]]:
    """Listen to what a robot's fusion node publishes."""
    return {'map': graph.hear(OccupancyGrid, f'/{robot}/global_map', qos.LATCHED),
            'transform': graph.hear(TransformStamped, f'/{robot}/relative_transforms',
                                    qos.LATCHED_PER_PAIR)}


def assert_true(transform: TransformStamped, own: str, peer: str) -> None:
    """Check a transform between two robots' maps against the truth."""
    assert transform.header.frame_id == 'map'
    assert transform.child_frame_id == f'{peer}/map'
    truth = compose(FRAMES[own], between(FRAMES[peer], Pose()))
    metres, radians = pose_error(convert.transform_from_message(transform), truth)
    assert metres < METRES
    assert radians < RADIANS


def share_of_walls(message: OccupancyGrid, robot: str, grid: Grid, world: str) -> float:
    """Share of a robot's walls that the global map shows, in the world of another robot."""
    merged = convert.grid_from_message(message, LIMIT)
    T_world_map = compose(FRAMES[world], between(FRAMES[robot], Pose()))
    cells = merged.point_to_cell(apply(T_world_map, grid.points(grid.occupied)))
    inside = ((cells >= 0) & (cells < merged.shape)).all(1)
    near = np.zeros(len(cells), bool)
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            there = np.clip(cells + (row, column), 0, np.array(merged.shape) - 1)
            near |= inside & merged.occupied[tuple(there.T)]
    return float(near.mean())


def test_two_robots_find_their_pose_and_share_one_map(graph: Graph) -> None:
    keep = [publish_map(graph, robot, map_of(robot)) for robot in ('robot1', 'robot2')]
    results = {robot: start(graph, robot) for robot in ('robot1', 'robot2')}
    clouds = graph.hear(PointCloud2, '/robot1/clusters', qos.LATCHED)
    poses = graph.hear(PoseArray, '/robot1/peer_poses', qos.STREAM)
    each = graph.hear(PoseWithCovarianceStamped, '/robot1/peer_poses/robot2', qos.STREAM)
    here = graph.node.create_publisher(PoseWithCovarianceStamped, '/robot2/pose', qos.STREAM)
    for robot, peer in (('robot1', 'robot2'), ('robot2', 'robot1')):
        graph.until(lambda: results[robot]['transform'], f'transform of {robot}')
        assert_true(results[robot]['transform'][-1], robot, peer)
        # A robot shows its own map alone before it has found the other.
        message = graph.until(lambda: results[robot]['map'] and all(share_of_walls(
            results[robot]['map'][-1], other, map_of(other), 'robot1') > 0.9
            for other in results) and results[robot]['map'][-1], f'global map of {robot}')
        assert message.header.frame_id == 'world'
    graph.until(lambda: clouds, 'clusters')
    assert clouds[-1].width > 20
    assert [f.name for f in clouds[-1].fields] == list(convert.CLUSTER_FIELDS)

    def told_where() -> bool:
        here.publish(convert.pose_with_covariance(Pose(1.0, 2.0, 0.5), np.eye(3), 'map', Time()))
        return bool(poses and each)
    graph.until(told_where, "the peer's pose")
    sigma = np.sqrt(np.diag(convert.planar_covariance(each[-1].pose.covariance)))
    assert (sigma > 0.01).all()     # that of the map's place and of the pose in it
    assert (sigma < 3.0).all()
    assert convert.pose_from_message(each[-1].pose.pose) == pytest.approx(
        convert.pose_from_message(poses[-1].poses[0]))
    seen = convert.pose_from_message(poses[-1].poses[0])
    truth = compose(compose(FRAMES['robot1'], between(FRAMES['robot2'], Pose())), (1.0, 2.0, 0.5))
    assert pose_error(seen, truth)[0] < METRES + 0.05
    assert len(keep) == 2
    graph.assert_clean(graph.processes.stop())


@pytest.fixture
def wifi_graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph whose nodes use the profile for wireless networks."""
    profile = str(ROOT / 'config' / 'fastdds_wifi.xml')
    with ros_graph(tmp_path, FASTRTPS_DEFAULT_PROFILES_FILE=profile,
                   FASTDDS_DEFAULT_PROFILES_FILE=profile) as made:
        yield made


def test_services_and_live_parameters_over_the_profile_for_wifi(wifi_graph: Graph,
                                                                tmp_path: Path) -> None:
    graph = wifi_graph
    result = start(graph, 'robot1', '-p', f'map_directory:={tmp_path}')
    assert not graph.call(Trigger, '/robot1/fusion_node/save_map').success
    keep = [publish_map(graph, robot, map_of(robot)) for robot in ('robot1', 'robot2')]
    graph.until(lambda: result['transform'] and result['map'], 'a pair and the global map')
    saved = graph.call(Trigger, '/robot1/fusion_node/save_map')
    assert saved.success, saved.message
    assert str(tmp_path / 'robot1_global_map.yaml') in saved.message
    assert read_map(tmp_path / 'robot1_global_map.yaml').occupied.sum() > 100
    request = SetParameters.Request(parameters=[
        Parameter('estimation_confidence', value=value).to_parameter_msg()
        for value in (0.9, 1.5)])
    assert request.parameters[0].value.type == ParameterType.PARAMETER_DOUBLE
    results = graph.call(SetParameters, '/robot1/fusion_node/set_parameters', request).results
    assert [r.successful for r in results] == [True, False]
    assert graph.call(Trigger, '/robot1/fusion_node/reset').success
    merged = graph.call(Trigger, '/robot1/fusion_node/merge')
    assert merged.message == 'connected: robot1, robot2'
    assert len(keep) == 2
    assert 'XML' not in graph.processes.log_path('robot1').read_text()
    graph.assert_clean(graph.processes.stop())


def bad_maps() -> Iterator[OccupancyGrid]:
    """Make every kind of map that is none."""
    def good() -> OccupancyGrid:
        return convert.grid_message(map_of('robot2'), 'map', Time(sec=1))
    nan = float('nan')
    yield OccupancyGrid()
    for field, value in (('width', 0), ('width', 4000000000), ('resolution', 0.0),
                         ('resolution', -0.05), ('resolution', nan)):
        message = good()
        setattr(message.info, field, value)
        yield message
    message = good()
    message.info.origin.position.x = nan
    yield message
    message = good()
    message.info.origin.orientation.z = nan
    yield message
    message = good()
    message.data = message.data[:-1]
    yield message
    message = good()
    message.data = array('b', [-1] * len(message.data))
    yield message


def counts(messages: list[DiagnosticArray], kind: str) -> int:
    """Read the newest count of a fault."""
    for message in reversed(messages):
        for value in message.status[0].values:
            if value.key == kind:
                return int(value.value)
    return 0


def test_a_peer_with_garbage_is_counted_and_the_others_go_on(graph: Graph) -> None:
    own = publish_map(graph, 'robot1', map_of('robot1'))
    result = start(graph, 'robot1')
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    garbage = graph.node.create_publisher(OccupancyGrid, '/robot2/map', qos.LATCHED)
    lies = graph.node.create_publisher(TransformStamped, '/robot2/relative_transforms',
                                       qos.LATCHED_PER_PAIR)
    graph.until(lambda: garbage.get_subscription_count() == 1 and lies.get_subscription_count(),
                'robot1 listening to robot2')
    for number, message in enumerate(bad_maps(), start=1):
        garbage.publish(message)
        graph.until(lambda: counts(diagnostics, 'map_of_robot2_unusable') >= number,
                    f'bad map {number} counted')
    lie = TransformStamped(child_frame_id='robot3/map')
    lie.transform.translation.x = float('inf')
    lies.publish(lie)
    graph.until(lambda: counts(diagnostics, 'transform_of_robot2_unusable') == 1, 'lie counted')
    assert not result['transform']
    garbage.publish(convert.grid_message(map_of('robot2'), 'map', Time(sec=2)))
    graph.until(lambda: result['transform'], 'transform after all')
    assert_true(result['transform'][-1], 'robot1', 'robot2')
    assert own is not None
    graph.assert_clean(graph.processes.stop())


def test_a_slam_node_that_is_killed_begins_a_new_map_that_joins_again(graph: Graph,
                                                                      tmp_path: Path) -> None:
    there, back = [(1.0, 1.0), (4.0, 1.2), (6.5, 2.6)], [(4.0, 3.2), (1.5, 4.5), (1.2, 2.0)]
    for part, begin in (('first', 100.0), ('second', 1000.0)):   # however long the first took
        write_fake_bag(tmp_path / part, waypoints=np.array(2 * (there + back)), start=begin)
    keep = publish_map(graph, 'robot1', fake_grid(fake_room()))
    result = start(graph, 'robot1')
    start(graph, 'robot2', '-p', 'use_sim_time:=true')

    def drive(part: str, use_sim_time: str) -> int:
        slam = graph.processes.start('slam', 'somfusion_ros.ros.slam_node', [
            '--ros-args', '-r', '__ns:=/robot2', '-p', 'laser_pose:=[0.1, 0.0, 0.0]',
            '-p', 'map_update_interval:=1.0', '-p', f'use_sim_time:={use_sim_time}'])
        graph.processes.start(f'player {part}', 'somfusion_ros.ros.apps.player', [
            str(tmp_path / part), '--rate', f'{2.0 / pace():.2f}', '--wait', '60', '--ros-args',
            '-r', '__ns:=/robot2'])
        return slam

    def joined() -> bool:     # the map of robot1 alone has no strangers, either
        if not (result['transform'] and result['map']):
            return False
        merged = convert.grid_from_message(result['map'][-1], LIMIT)
        return share_of_strangers(merged) < 0.03
    first = drive('first', 'false')
    graph.until(joined, 'one map of both')
    os.kill(first, signal.SIGKILL)
    graph.processes.stop(['slam', 'player first'])
    assert graph.processes.statuses.pop('slam') == -signal.SIGKILL
    drive('second', 'true')
    log = graph.processes.log_path('robot1')
    graph.until(lambda: 'robot2 began another map' in log.read_text(), 'word of a new map')
    result['map'].clear()      # what was with the old one counts no more
    result['transform'].clear()
    graph.until(joined, 'one map of both, with a new one of robot2')
    assert keep
    graph.assert_clean(graph.processes.stop())


def share_of_strangers(merged: Grid) -> float:
    """Share of the wall cells of a map in robot1's frame that lie over 0.2 m from any wall."""
    truth = fake_grid(fake_room())
    walls = truth.points(truth.occupied)
    away = cKDTree(walls).query(merged.points(merged.occupied))[0]
    return float((away > 0.2).mean())


def test_a_sighting_joins_robots_whose_maps_do_not_overlap(graph: Graph) -> None:
    left = cut_to_walls(map_of('robot1'), 'robot1', (-1.0, -1.0), (5.5, 12.0))
    right = cut_to_walls(map_of('robot3'), 'robot3', (8.5, -1.0), (15.0, 12.0))
    keep = [publish_map(graph, 'robot1', left), publish_map(graph, 'robot3', right)]
    result = start(graph, 'robot1', '-p', 'estimation_rate:=0.01', '-p', 'map_frame:=robot1/map',
                   '-p', 'world_frame:=robot1/world')
    publishers = [graph.node.create_publisher(PoseWithCovarianceStamped, topic, qos.STREAM)
                  for topic in ('/robot1/pose', '/robot3/pose', '/robot1/encounters')]
    graph.until(lambda: all(p.get_subscription_count() for p in publishers), 'robot1 listening')
    T_walls_base = {'robot1': Pose(5.0, 2.0, 0.3), 'robot3': Pose(7.0, 2.5, 2.0)}
    own, peer = (compose(FRAMES[robot], T_walls_base[robot]) for robot in ('robot1', 'robot3'))
    seen = between(T_walls_base['robot1'], T_walls_base['robot3'])

    def met() -> bool:
        for publisher, pose, frame in zip(publishers, (own, peer, seen),
                                          ('robot1/map', 'map', 'robot3')):
            publisher.publish(convert.pose_with_covariance(pose, np.eye(3), frame, Time(sec=9)))
        return bool(result['transform'])
    graph.until(met, 'transform by sighting')
    transform = result['transform'][-1]
    assert (transform.header.frame_id, transform.child_frame_id) == ('robot1/map', 'robot3/map')
    transform.header.frame_id = 'map'
    assert_true(transform, 'robot1', 'robot3')
    graph.until(lambda: result['map'] and share_of_walls(
        result['map'][-1], 'robot3', right, 'robot1') > 0.9, "global map with the peer's walls")
    assert result['map'][-1].header.frame_id == 'robot1/world'
    assert keep
    graph.assert_clean(graph.processes.stop())


def test_known_poses_place_maps_without_a_match(graph: Graph) -> None:
    keep = [publish_map(graph, robot, map_of(robot)) for robot in ('robot1', 'robot2')]
    poses = [f'{robot} {x} {y} {theta}' for robot, (x, y, theta) in (
        (robot, between(FRAMES[robot], Pose())) for robot in ('robot1', 'robot2'))]
    graph.start('alone', 'fusion_node', '/', *FAST, '-r', 'map:=/robot1/map', '-p',
                'robot_name:=robot1', '-p', 'known_init_poses:=true', '-p',
                f'initial_poses:={poses}'.replace("'", '"'))
    maps = graph.hear(OccupancyGrid, '/global_map', qos.LATCHED)
    graph.until(lambda: maps and share_of_walls(
        maps[-1], 'robot2', map_of('robot2'), 'robot1') > 0.9, 'global map of both')
    assert keep
    graph.assert_clean(graph.processes.stop())


def cut_to_walls(grid: Grid, robot: str, low: tuple[float, float],
                 high: tuple[float, float]) -> Grid:
    """Keep the part of a robot's map inside a box of the walls' own frame."""
    straight = Grid(grid.evidence, grid.resolution, Pose.from_array(
        between(FRAMES[robot], grid.T_frame_grid)))
    return Grid(cut_grid(straight, low, high).evidence, grid.resolution, grid.T_frame_grid)


def run_alone(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run fusion_node until it ends by itself."""
    return subprocess.run([sys.executable, '-m', 'somfusion_ros.ros.fusion_node', *arguments],
                          env=ros_environment(), capture_output=True, text=True, timeout=30)


def test_in_the_root_namespace_without_a_name_it_refuses_to_start() -> None:
    ended = run_alone()
    assert ended.returncode != 0
    assert 'robot_name' in ended.stderr
    assert 'Traceback' not in ended.stderr


@pytest.mark.parametrize('parameter', ['merging_rate:=-1.0', 'merging_rate:=fast',
                                       'initial_poses:=["robot1 here"]'])
def test_a_bad_parameter_is_said_in_one_sentence(parameter: str) -> None:
    ended = run_alone('--ros-args', '-r', '__ns:=/robot1', '-p', parameter)
    assert ended.returncode != 0
    assert parameter.partition(':')[0] in ended.stderr
    assert 'Traceback' not in ended.stderr


def test_both_signals_end_it_also_in_the_middle_of_work(graph: Graph) -> None:
    large = fake_grid(fake_room(60.0, 50.0), 0.025)
    keep = [publish_map(graph, robot, large) for robot in ('robot1', 'robot2')]
    found = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        name = number.name
        start(graph, 'robot1')
        pid = graph.processes.start(name, 'somfusion_ros.ros.fusion_node', [
            '--ros-args', '-r', '__ns:=/robot1', '-r', '__node:=other', *FAST])
        log = graph.processes.log_path(name)
        graph.until(lambda: 'found robot2' in log.read_text(), 'the maps coming in')
        os.kill(pid, number)
        graph.until(lambda: name in graph.processes.ended(), f'end after {name}')
        found[name] = graph.processes.statuses[name]
        graph.processes.stop()
    assert keep
    graph.assert_clean(found)
