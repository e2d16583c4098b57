# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""slam_node without an Odometry topic: odometry from TF alone, and none at all."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from helpers import need_ros, need_tf
import pytest

need_ros()
need_tf()

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402, I100
from live_robot import Robot, ROUND  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from somfusion_ros.geometry import Pose  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

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
