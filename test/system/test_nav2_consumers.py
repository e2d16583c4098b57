# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Nav2, AMCL and explore_lite get of a robot: maps that they read, and a live `world`."""

from collections.abc import Iterator
from pathlib import Path
import time

from helpers import fake_grid, fake_room, need_ros, need_tf, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, inverse, Pose

need_ros()
need_tf()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from live_robot import Robot, ROUND  # noqa: E402
from map_readers import amcl, explore_lite, FREE, static_layer, UNKNOWN, WALL  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from tf_buffer import NoTransformError, TfBuffer  # noqa: E402

pytestmark = pytest.mark.system
OWN_TREE = ('-r', '/tf:=tf', '-r', '/tf_static:=tf_static')
VOLATILE = QoSProfile(depth=10)   # reliable and volatile, as RViz and explore_lite subscribe
PATIENCE = 0.3   # [s] that explore_lite and Nav2's behaviours wait for a transform


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def assert_readable(message: OccupancyGrid, graded: OccupancyGrid | None) -> None:
    """Check that every consumer sees walls as walls, and free space as free."""
    nav2, localiser = static_layer(message), amcl(message)
    assert (nav2 == localiser).all()
    assert (nav2 == explore_lite(message)).all()
    assert {WALL, FREE, UNKNOWN} == set(np.unique(nav2))
    origin = message.info.origin
    assert convert.yaw(origin.orientation) == 0.0   # Nav2's costmaps know no turned origin
    if graded is not None:
        certain = convert.grid_from_message(graded, 10 ** 7)
        assert ((nav2 == WALL) == certain.occupied).all()
        assert ((nav2 == FREE) == certain.free).all()
        freed = (static_layer(graded) == FREE) & certain.occupied
        assert freed.any()   # why the graded one is not for Nav2


def test_maps_are_what_nav2_and_amcl_read_and_come_again_to_those_who_come_late(
        graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    graph.start('fusion', 'fusion_node', '/robot1', '-p', 'map_update_interval:=0.5')
    graded = graph.hear(OccupancyGrid, '/robot1/map_graded', qos.LATCHED)
    robot.start()
    robot.drive(100)
    graph.until(lambda: graded and robot.maps and
                graded[-1].header.stamp == robot.maps[-1].header.stamp
                == robot.poses[-1].header.stamp
                and len(graded[-1].data) == len(robot.maps[-1].data), 'both maps')
    assert_readable(robot.maps[-1], graded[-1])
    # The robot stands still now and nothing changes: who comes late gets a map all the same.
    late = {name: graph.hear(OccupancyGrid, f'/robot1/{name}', VOLATILE)
            for name in ('map', 'global_map', 'global_map_graded')}
    graph.until(lambda: all(late.values()), 'all maps for late and volatile subscribers', 10.0)
    assert late['global_map'][-1].header.frame_id == 'world'
    graph.until(lambda: FREE in static_layer(late['global_map'][-1]), 'a global map of the drive')
    assert_readable(late['global_map'][-1], None)
    graph.assert_clean(graph.processes.stop())


class Asker:
    """A robot's driver and somebody who asks where the robot is now, by tf2's rules."""

    def __init__(self, graph: Graph, robot: str) -> None:
        self.graph, self.buffer = graph, TfBuffer()
        self._tf = graph.node.create_publisher(TFMessage, f'/{robot}/tf', qos.TRANSFORMS)
        graph.node.create_subscription(
            TFMessage, f'/{robot}/tf', lambda m: self.buffer.add(m.transforms), qos.TRANSFORMS)

    def drive(self) -> None:
        """Publish odom -> base_link, as the robot's driver does, and map -> odom as its SLAM."""
        now = time.time()
        self._tf.publish(TFMessage(transforms=[
            convert.transform_message(Pose(), 'odom', 'base_link', convert.time_message(now)),
            convert.transform_message(Pose(1.0, 2.0, 0.3), 'map', 'odom',
                                      convert.time_message(now + 0.5))]))

    def answered(self, times: int) -> int:
        """Ask for world <- base_link at the present so many times; count the answers."""
        answers = 0
        for _ in range(times):
            asked, end = time.time(), time.monotonic() + PATIENCE
            while time.monotonic() < end:
                self.drive()
                self.graph.spin_for(0.02)
                try:
                    self.buffer.lookup('world', 'base_link', asked)
                except NoTransformError:
                    continue
                answers += 1
                break
            self.graph.spin_for(0.05)
        return answers


def test_the_present_place_in_world_is_there_whenever_it_is_asked_for(graph: Graph) -> None:
    asker = Asker(graph, 'robot1')
    # Merging as seldom as can be: the rate of transforms must not depend on it.
    graph.start('fusion', 'fusion_node', '/robot1', *OWN_TREE, '-p', 'merging_rate:=0.1')

    def known() -> bool:
        asker.drive()
        try:
            return bool(asker.buffer.lookup('world', 'base_link'))
        except NoTransformError:
            return False
    graph.until(known, 'the tree from world to base_link')
    assert asker.answered(60) == 60
    graph.assert_clean(graph.processes.stop())


def test_slam_keeps_the_tree_alive_while_no_scan_is_used(graph: Graph) -> None:
    robot, heard = Robot(graph, 'robot1', ROUND), TfBuffer()
    graph.node.create_subscription(TFMessage, '/robot1/tf', lambda m: heard.add(m.transforms),
                                   qos.TRANSFORMS)
    robot.start(*OWN_TREE, '-p', 'transform_timeout:=0.2')
    robot.drive(30)
    last = robot.stamps[29]
    for step in range(1, 6):   # scans that see nothing: map -> odom holds still, and is said to
        robot.publish_odometry(29, last + 0.1 * step)
        robot.publish(29, [float('inf')] * 257, last + 0.1 * step)

    def present() -> bool:
        try:
            return bool(heard.lookup('map', 'odom', last + 0.6))
        except NoTransformError:
            return False
    graph.until(present, 'map <- odom at the newest scan')
    graph.assert_clean(graph.processes.stop())


def test_world_is_pinned_where_an_anchor_is_given_and_every_change_is_counted(
        graph: Graph) -> None:
    walls, frames = fake_room(14.0, 11.0), {'robot1': Pose(), 'robot2': Pose(3.0, -2.0, 0.6)}
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    keep, trees = [], {}
    for robot, pose in frames.items():
        trees[robot] = TfBuffer()
        graph.node.create_subscription(
            TFMessage, f'/{robot}/tf', lambda m, tree=trees[robot]: tree.add(m.transforms),
            qos.TRANSFORMS)
        keep.append(graph.node.create_publisher(OccupancyGrid, f'/{robot}/map', qos.LATCHED))
        keep[-1].publish(convert.grid_message(fake_grid(walls, T_map_walls=pose), 'map',
                                              Time(sec=1)))
        graph.start(robot, 'fusion_node', f'/{robot}', *OWN_TREE, '-p', 'estimation_rate:=5.0',
                    '-p', 'discovery_rate:=5.0', '-p', 'world_anchor:=robot2')
    views = {kind: graph.hear(kind, f'/robot1/peers/robot2/{name}', qos.LATCHED)
             for kind, name in ((OccupancyGrid, 'map'), (PointCloud2, 'clusters'))}

    def values(robot: str) -> dict[str, str]:
        return next(({v.key: v.value for v in s.values} for m in reversed(diagnostics)
                     for s in m.status if s.name == f'{robot}/fusion_node'), {})
    graph.until(lambda: all(values(robot).get('connected') == 'robot1, robot2'
                            for robot in frames), 'both connected')
    graph.until(lambda: values('robot1').get('world_changes') == '1', 'the change of world')
    assert values('robot2')['world_changes'] == '0'   # pinned to it
    assert values('robot1')['world_is_map_of'] == 'robot2'
    assert 'world changed, for the first time' in graph.processes.log_path('robot1').read_text()
    T_map1_map2 = compose(frames['robot1'], inverse(frames['robot2']))
    for robot, tree in trees.items():
        other = {'robot1': 'robot2', 'robot2': 'robot1'}[robot]
        graph.until(lambda: f'{other}/map' in tree.frames(), 'the frame of the other map')
        found = tree.lookup('map', f'{other}/map')
        truth = T_map1_map2 if robot == 'robot1' else between(T_map1_map2, Pose())
        assert pose_error(found, truth)[0] < 0.15
        at_world = tree.lookup('world', 'map' if robot == 'robot2' else 'robot2/map')
        assert pose_error(at_world, Pose())[0] < 1e-6

    # What the peer has seen is shown in this robot's tree, where it is.
    for kind in (OccupancyGrid, PointCloud2):
        graph.until(lambda: views[kind], f'{kind.__name__} of the peer')
        assert views[kind][-1].header.frame_id in trees['robot1'].frames()
        assert views[kind][-1].header.frame_id == 'robot2/map'
    shown = convert.grid_from_message(views[OccupancyGrid][-1], 10 ** 7)
    assert shown.occupied.sum() > 100
    assert keep
    graph.assert_clean(graph.processes.stop())
