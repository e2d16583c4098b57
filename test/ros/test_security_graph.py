# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy allows what the nodes do, and nothing that they never do."""

from collections.abc import Callable, Iterator
from fnmatch import fnmatch
import time
from typing import Any

from helpers import need_ros
from pace import patient
import pytest

need_ros()

from nav_msgs.msg import OccupancyGrid  # noqa: E402, I100
import rclpy  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from somfusion_ros.ros.common import names, qos  # noqa: E402
from somfusion_ros.ros.common.managed import ManagedNode  # noqa: E402
from somfusion_ros.ros.common.security_policy import allowed, Interface  # noqa: E402
from somfusion_ros.ros.fusion.node import FusionNode  # noqa: E402
from somfusion_ros.ros.slam.node import SlamNode  # noqa: E402
from std_msgs.msg import String  # noqa: E402

WAIT = 30.0    # [s]
# What is there only with other parameters, packages or peers than here.
SOMETIMES = {'joint_states', 'joint_path', 'map', 'tf', 'tf_static', 'clock', 'parameter_events',
             'save_map_as', 'get_type_description', 'peer_poses/*', 'peers/*'}


@pytest.fixture
def ros(ros_domain: int) -> Iterator[SingleThreadedExecutor]:
    """Start rclpy as robot1."""
    rclpy.init(args=['--ros-args', '-r', '__ns:=/robot1'])
    executor = SingleThreadedExecutor()
    yield executor
    for node in executor.get_nodes():
        if isinstance(node, ManagedNode):
            node.close(5.0)
        node.destroy_node()
    rclpy.try_shutdown()


def done_by(node: Node, name: str) -> Interface:
    """Return what a node says, hears and answers, as all in the graph see it."""
    at = name, '/robot1'
    return Interface(*(tuple(topic for topic, _ in found) for found in (
        node.get_publisher_names_and_types_by_node(*at),
        node.get_subscriber_names_and_types_by_node(*at),
        node.get_service_names_and_types_by_node(*at))))


def short(rule: str, node: str) -> str:
    """Return a name as it is known in robot1's namespace, or below its node."""
    return rule.removeprefix('/robot1/').removeprefix(f'{node}/').lstrip('/')


def spin_until(executor: SingleThreadedExecutor, true: Callable[[], Any]) -> None:
    """Spin until something is true."""
    begin = time.monotonic()
    while not true():
        assert patient(WAIT, begin)
        executor.spin_once(0.1)


@pytest.mark.parametrize(('kind', 'name'), [(SlamNode, 'slam_node'), (FusionNode, 'fusion_node')])
def test_the_policy_allows_what_a_node_does_and_little_else(
        kind: type[ManagedNode], name: str, ros: SingleThreadedExecutor) -> None:
    node = kind()
    looker = Node('looker', namespace='/robot2', use_global_arguments=False)
    for one in (node, looker):
        ros.add_node(one)
    told = [looker.create_publisher(*one, qos.LATCHED) for one in (
        (String, f'/robot2/{names.TEAM_STATE}'), (OccupancyGrid, f'/robot4/{names.MAP}'))]
    node.autostart()
    does = [done_by(looker, name)]
    if isinstance(node, FusionNode):
        for topic in (names.TEAM_STATE, f'robot4/{names.MAP_EPOCH}'):
            spin_until(ros, lambda: any(one.endswith(topic) and '/robot1/' not in one
                                        for one in done_by(looker, name).subscribe))
        does.append(done_by(looker, name))
        node._link.want({'robot2'})       # what it does once it is joined with another robot,
        node._views.want({'robot2'}, {'robot2'})
        for topic in (names.TEAM_DEPARTED, names.TEAM_DEPARTED_VIEWS):    # and others are gone
            node._departed._publisher(topic, 'robot3')
        node._departed.fetch({'robot3': 'robot2'}, ['robot3'])
        spin_until(ros, lambda: any('departed' in one for one in done_by(looker, name).publish))
    does.append(done_by(looker, name))
    for may, uses in zip(allowed('robot1', name), map(set().union, *does)):
        assert not [one for one in uses if not any(fnmatch(one, rule) for rule in may)]
        assert not [rule for rule in may if not any(fnmatch(one, rule) for one in uses)
                    and short(rule, name) not in SOMETIMES]
    assert len(told) == 2
