# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of different days, played by one clock: every robot's tree is whole at the present."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal
import time

from helpers import need_ros, need_tf, write_fake_bag
import pytest

need_ros()
need_tf()

from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402, I100
from ros_graph import Graph, ros_graph  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from tf_buffer import NoTransformError, TfBuffer  # noqa: E402

pytestmark = pytest.mark.system
OWN_TREE = ('-r', '/tf:=tf', '-r', '/tf_static:=tf_static')


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """Return a graph that ends with the test."""
    with ros_graph(tmp_path) as made:
        yield made


def test_a_played_team_lives_in_the_time_of_the_recording(graph: Graph, tmp_path: Path) -> None:
    starts, trees = {'robot1': 100.0, 'robot2': 90000.0}, {}
    clock = graph.hear(Clock, '/clock', qos.LATEST)
    poses = {robot: graph.hear(PoseWithCovarianceStamped, f'/{robot}/pose', qos.STREAM)
             for robot in starts}
    for robot, start in starts.items():
        write_fake_bag(tmp_path / robot, start=start)
        tree = trees[robot] = TfBuffer()
        for topic, fixed, profile in (('tf', False, qos.TRANSFORMS),
                                      ('tf_static', True, qos.STATIC_TRANSFORMS)):
            graph.node.create_subscription(
                TFMessage, f'/{robot}/{topic}',
                lambda m, tree=tree, fixed=fixed: tree.add(m.transforms, fixed), profile)
        for kind in ('slam_node', 'fusion_node'):
            graph.start(f'{kind} {robot}', kind, f'/{robot}', *OWN_TREE, '-p',
                        'use_sim_time:=true')
    graph.processes.start('player', 'somfusion_ros.ros.apps.player', [
        *(str(tmp_path / robot) for robot in starts), '--clock', '--wait', '60'])

    def placed(robot: str) -> bool:
        try:   # at the present, as who navigates asks
            now = convert.seconds(clock[-1].clock)
            return 95.0 < now < 200.0 and bool(trees[robot].lookup('world', 'laser', now - 0.3))
        except (NoTransformError, IndexError):
            return False
    for robot in starts:
        graph.until(lambda: placed(robot), f'the whole tree of {robot} at the present')
        assert 95.0 < convert.seconds(poses[robot][-1].header.stamp) < 200.0
    stamps = [convert.seconds(message.clock) for message in clock]
    assert stamps == sorted(stamps)
    graph.assert_clean(graph.processes.stop())


@pytest.mark.parametrize('node', ['slam_node', 'fusion_node'])
def test_a_signal_during_the_start_is_clean(node: str, graph: Graph) -> None:
    began = time.monotonic()
    pid = graph.processes.start('first', f'somfusion_ros.ros.{node}', [
        '--ros-args', '-r', '__ns:=/robot1'])
    maps = Path(f'/proc/{pid}/maps')
    graph.until(lambda: '/numpy/' in maps.read_text(), 'the imports of the node')
    importing = time.monotonic() - began
    graph.until(lambda: graph.node.count_publishers('/diagnostics'), 'the node')
    started = time.monotonic() - began
    graph.processes.stop()
    for share in (0.2, 0.8):   # among the imports, and while the node is made
        name = f'at {share}'
        pid = graph.processes.start(name, f'somfusion_ros.ros.{node}', [
            '--ros-args', '-r', '__ns:=/robot1'])
        maps = Path(f'/proc/{pid}/maps')
        graph.until(lambda: '/numpy/' in maps.read_text(), 'the imports of the node')
        graph.spin_for(share * (started - importing))
        os.kill(pid, signal.SIGINT)
        graph.until(lambda: name in graph.processes.ended(), f'the end of {node}')
    graph.assert_clean(graph.processes.statuses)
