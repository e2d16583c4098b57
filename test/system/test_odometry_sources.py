# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""slam_node with other sensors: odometry from TF alone or none, other lasers, two at once."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from helpers import fake_scan, need_ros, need_tf
import numpy as np
import pytest

need_ros()
need_tf()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from live_robot import Robot, ROUND, WALLS  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from sensor_msgs.msg import LaserEcho, MultiEchoLaserScan, PointCloud2  # noqa: E402
from somfusion_ros.geometry import Pose  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from somfusion_ros.slam.scan import cloud  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

FRONT, BACK = Pose(0.2, 0.0, 0.0), Pose(-0.2, 0.0, np.pi)
pytestmark = pytest.mark.system


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Give a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


class TransformRobot(Robot):
    """A robot whose odometry is on /tf only, in a frame of another name."""

    def __init__(self, graph: Graph, name: str, way: Any) -> None:
        super().__init__(graph, name, way)
        self._odom = graph.node.create_publisher(TFMessage, '/tf', qos.TRANSFORMS)

    def publish_odometry(self, i: int, stamp: float | None = None) -> None:
        """Publish the transform of the odometry."""
        when = convert.time_message(self.stamps[i] if stamp is None else stamp)
        self._odom.publish(TFMessage(transforms=[convert.transform_message(
            Pose.from_array(self.odometry[i]), f'{self.name}/odom_combined',
            f'{self.name}/base_footprint', when)]))


@pytest.mark.parametrize('source', ['auto', 'tf'])
def test_odometry_from_tf_alone(graph: Graph, source: str) -> None:
    robot = TransformRobot(graph, 'robot1', ROUND)
    robot.start('-p', f'odometry_source:={source}')
    robot.drive(100)
    robot.assert_on_course()
    graph.assert_clean(graph.processes.stop())


def test_no_odometry_at_all(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot._odom = robot._scan   # whose listener is waited for
    robot.publish_odometry = lambda i, stamp=None: None
    robot.start('-p', 'odometry_source:=none')
    robot.drive(100)
    robot.assert_on_course()
    graph.until(lambda: diagnostics and diagnostics[-1].status[0].message == 'ok', 'no warning')
    graph.assert_clean(graph.processes.stop())


def scans_of(diagnostics: DiagnosticArray) -> int:
    """Return how many scans the node has taken."""
    return int({told.key: told.value for told in diagnostics.status[0].values}.get('scans', 0))


class TwoLasers(Robot):
    """A robot with a laser of several echoes to the front; that to the back sends clouds."""

    def __init__(self, graph: Graph, name: str, way: Any) -> None:
        super().__init__(graph, name, way)
        graph.node.destroy_publisher(self._scan)
        self._scan = graph.node.create_publisher(MultiEchoLaserScan, f'/{name}/front', qos.REPLAY)
        self._back = graph.node.create_publisher(PointCloud2, f'/{name}/back', qos.REPLAY)
        static = graph.node.create_publisher(TFMessage, '/tf_static', qos.LATCHED)
        static.publish(TFMessage(transforms=[
            convert.transform_message(mount, 'base_link', f'{laser}_laser', Time())
            for laser, mount in (('front', FRONT), ('back', BACK))]))

    def publish(self, i: int, ranges: Any = None, stamp: float | None = None) -> None:
        """Publish what both lasers see, half a turn each."""
        when = self.stamps[i] if stamp is None else stamp
        seen = fake_scan(WALLS, self.truth[i], beams=181, field_of_view=np.pi, T_base_laser=FRONT)
        message = MultiEchoLaserScan(
            angle_min=seen.angle_min, angle_increment=seen.angle_increment,
            angle_max=-seen.angle_min, range_min=seen.range_min, range_max=seen.range_max,
            ranges=[LaserEcho(echoes=[float(r)]) for r in seen.ranges])
        message.header.stamp, message.header.frame_id = convert.time_message(when), 'front_laser'
        self._scan.publish(message)
        seen = fake_scan(WALLS, self.truth[i], beams=181, field_of_view=np.pi, T_base_laser=BACK)
        outline = cloud(replace(seen, T_base_laser=Pose()), 30.0).outline
        rows = np.zeros((np.count_nonzero(outline.hit), 7), np.float32)
        rows[:, :2] = outline.ends[outline.hit]
        self._back.publish(convert.cluster_cloud(rows, 'back_laser', convert.time_message(
            when + 0.02)))


def test_two_lasers_of_other_types_are_both_used(graph: Graph) -> None:
    robot = TwoLasers(graph, 'robot1', ROUND)
    diagnostics = graph.hear(DiagnosticArray, '/diagnostics', qos.STREAM)
    robot.launch('-p', 'scan_topics:=front, back')
    robot.drive_until_heard()
    robot.drive(60)
    robot.assert_on_course()
    words = graph.processes.log_path('slam robot1').read_text()
    assert '/robot1/back is a sensor_msgs/msg/PointCloud2: it is read' in words
    graph.until(lambda: diagnostics and scans_of(diagnostics[-1]) > 80, 'scans of both lasers')
    graph.assert_clean(graph.processes.stop())
