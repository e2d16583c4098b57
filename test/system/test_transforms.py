# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""TF with the real message type: where the laser sits, and where map and world are."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from helpers import fake_grid, fake_room, need_ros, need_tf, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, inverse, Pose

need_ros()
need_tf()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from live_robot import MOUNT, Robot, ROUND  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

pytestmark = pytest.mark.system
OWN_TREE = ('-r', '/tf:=tf', '-r', '/tf_static:=tf_static')
METRES, RADIANS = 0.15, np.radians(2.0)


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def publish_mount(graph: Graph, topic: str, *frames: str) -> Any:
    """Publish the mount of the laser as a chain of fixed transforms, the last one turned."""
    static = graph.node.create_publisher(TFMessage, topic, qos.STATIC_TRANSFORMS)
    steps = [Pose(0.2, -0.1, 0.0)] * (len(frames) - 2)
    steps.append(Pose.from_array(between(Pose(0.2 * len(steps), -0.1 * len(steps)), MOUNT)))
    static.publish(TFMessage(transforms=[
        convert.transform_message(pose, parent, child, Time())
        for pose, parent, child in zip(steps, frames[:-1], frames[1:], strict=True)]))
    return static


def newest(messages: list[TFMessage], parent: str, child: str) -> Any:
    """Return the transform between two frames that was heard last; None before one was."""
    return next((t for m in reversed(messages) for t in m.transforms
                 if (t.header.frame_id, t.child_frame_id) == (parent, child)), None)


@pytest.mark.parametrize('shared', [False, True], ids=['own tree', 'one tree with prefixes'])
def test_a_robot_is_placed_in_its_map_by_tf_alone(shared: bool, graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    prefix, where = ('robot1/', '') if shared else ('', '/robot1')
    robot.laser_frame = f'{prefix}laser'
    heard = graph.hear(TFMessage, f'{where}/tf', qos.TRANSFORMS)
    kept = publish_mount(graph, f'{where}/tf_static', f'{prefix}base_link', f'{prefix}plate',
                         robot.laser_frame)
    robot.launch(*(() if shared else OWN_TREE), *(
        part for name in ('map', 'odom', 'base')
        for part in ('-p', f'{name}_frame:={prefix}{"base_link" if name == "base" else name}')))
    robot.drive_until_heard()
    robot.drive(100)
    robot.assert_on_course()

    def placed() -> bool:
        found = newest(heard, f'{prefix}map', f'{prefix}odom')
        if found is None:
            return False
        by_tf = compose(convert.transform_from_message(found), robot.odometry[99])
        metres, radians = pose_error(by_tf, robot.true_pose(99))
        return metres < METRES and radians < RADIANS
    graph.until(placed, 'map -> odom that places the robot')
    assert robot.poses[-1].header.frame_id == f'{prefix}map'
    frames = {(t.header.frame_id, t.child_frame_id) for m in heard for t in m.transforms}
    assert frames == {(f'{prefix}map', f'{prefix}odom')}   # odom -> base is the odometry's
    graph.assert_clean(graph.processes.stop())
    assert kept


def test_a_mount_that_is_missing_is_said_and_one_that_comes_late_is_used(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.launch(*OWN_TREE)
    stamps = iter(np.arange(0.0, 4.0, 1e-5))   # more than a slow machine can use up

    def said() -> bool:
        robot.publish(0, stamp=float(next(stamps)))
        words = graph.processes.log_path('slam robot1').read_text()
        return 'no transform base_link -> laser on /tf_static' in words
    graph.until(said, 'the words that say what is missing')
    graph.until(lambda: diagnostics and diagnostics[-1].status[0].level == DiagnosticStatus.WARN
                and 'base_link -> laser' in diagnostics[-1].status[0].message, 'the status')
    assert not robot.poses
    kept = publish_mount(graph, '/robot1/tf_static', 'base_link', 'laser')
    robot.drive_until_heard()
    robot.drive(60)
    robot.assert_on_course()
    words = graph.processes.log_path('slam robot1').read_text()
    assert words.count('scans_without_mount') == 1
    graph.assert_clean(graph.processes.stop())
    assert kept


@pytest.mark.parametrize('shared', [False, True], ids=['own trees', 'one tree with prefixes'])
def test_a_team_is_placed_in_the_world_on_tf(shared: bool, graph: Graph) -> None:
    walls, frames = fake_room(14.0, 11.0), {'robot1': Pose(), 'robot2': Pose(3.0, -2.0, 0.6)}
    heard, kept = {}, []
    for robot, pose in frames.items():
        publisher = graph.node.create_publisher(OccupancyGrid, f'/{robot}/map', qos.LATCHED)
        publisher.publish(convert.grid_message(fake_grid(walls, T_map_walls=pose), 'map',
                                               Time(sec=1)))
        kept.append(publisher)
        graph.start(robot, 'fusion_node', f'/{robot}', '-p', 'estimation_rate:=5.0',
                    '-p', 'merging_rate:=5.0', '-p', 'discovery_rate:=5.0',
                    *(('-p', f'map_frame:={robot}/map') if shared else OWN_TREE))
        topic = '/tf' if shared else f'/{robot}/tf'
        heard[robot] = graph.heard.get(topic) or graph.hear(TFMessage, topic, qos.TRANSFORMS)
    T_world_peer = compose(frames['robot1'], inverse(frames['robot2']))
    for robot in frames:
        names = {name: f'{name}/map' if shared or name != robot else 'map' for name in frames}
        for name, truth in (('robot1', Pose()), ('robot2', T_world_peer)):
            found = graph.until(lambda: newest(heard[robot], 'world', names[name]),
                                f'world -> {names[name]}')
            error = pose_error(convert.transform_from_message(found), truth)
            assert error[0] < METRES, (robot, name, error)
            assert error[1] < RADIANS
    graph.until(lambda: all(len(m) > 8 for m in heard.values()), 'repeated transforms')
    if shared:   # two that place the same frame would make it flicker
        late = [[t.child_frame_id for t in m.transforms] for m in heard['robot1'][-4:]]
        assert all(len(children) == 1 for children in late), late
    graph.assert_clean(graph.processes.stop())
