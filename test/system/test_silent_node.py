# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where nothing comes out, both nodes say why: one line in the log, and a status."""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
import re

from helpers import fake_grid, fake_room, need_ros
import pytest

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from live_robot import BEAMS, Robot, ROUND  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from ros_graph import Graph, ros_graph  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402

pytestmark = pytest.mark.system


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def said(graph: Graph, node: str, words: str, meanwhile: Callable[[], None] = lambda: None) -> str:
    """Wait until a status warns in these words; give the node's log."""
    heard = graph.heard.get('/diagnostics') or graph.hear(DiagnosticArray, '/diagnostics',
                                                          qos.STREAM)

    def warned() -> bool:
        meanwhile()
        return any(words in s.message and s.level == DiagnosticStatus.WARN
                   for message in heard[-4:] for s in message.status if node in s.name)
    graph.until(warned, words)
    name = 'slam robot1' if node == 'slam_node' else 'fusion'
    return graph.processes.log_path(name).read_text()


def test_slam_node_names_scans_without_a_usable_beam(graph: Graph) -> None:
    robot, numbers = Robot(graph, 'robot1', ROUND), count()
    robot.launch('-p', 'laser_pose:=[0.12,0.0,0.1]')

    def blind() -> None:
        stamp = robot.stamps[0] + 0.05 * next(numbers)
        robot.publish_odometry(0, stamp)
        robot.publish(0, [float('inf')] * BEAMS, stamp)
    words = said(graph, 'slam_node', 'no scan could be used yet', blind)
    assert f'scans_without_returns: none of {BEAMS} beams can be used: {BEAMS} inf' in words
    graph.assert_clean(graph.processes.stop())


def test_slam_node_says_what_it_waits_for(graph: Graph) -> None:
    robot = Robot(graph, 'robot1', ROUND)
    robot.launch('-p', 'laser_pose:=[0.12,0.0,0.1]')
    said(graph, 'slam_node', 'no scan yet')
    # It may not have seen the publisher yet.
    line = re.compile(r'seconds_without_scan: no scan yet(: nobody publishes /robot1/scan)? '
                      r'\(on /robot1/scan, /robot1/odom, /tf\)')
    graph.until(lambda: line.search(graph.processes.log_path('slam robot1').read_text()),
                'the line in the log')
    stamps = iter(range(1, 100000))
    said(graph, 'slam_node', 'no odometry yet',
         lambda: robot.publish(0, stamp=robot.stamps[0] + 1e-3 * next(stamps)))
    robot.drive_until_heard()
    robot.drive(20)
    words = said(graph, 'slam_node', 'no scan for ')
    assert words.count('seconds_without_scan') == 1   # repeated only after a minute
    graph.assert_clean(graph.processes.stop())


def test_fusion_node_says_that_no_map_can_reach_it(graph: Graph) -> None:
    volatile = graph.node.create_publisher(OccupancyGrid, '/robot1/map', qos.LATEST)
    graph.start('fusion', 'fusion_node', '/robot1')
    message = convert.grid_message(fake_grid(fake_room()), 'map', Time(sec=1))
    words = said(graph, 'fusion_node', "the robot's own map has not come yet",
                 lambda: volatile.publish(message))
    graph.until(lambda: 'incompatible QoS' in graph.processes.log_path('fusion').read_text(),
                'the line in the log')
    assert words.count('DURABILITY') <= 1
    graph.assert_clean(graph.processes.stop())
