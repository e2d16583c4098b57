# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a slam_node says of topics that nobody publishes, and of frames that do not join."""

from types import SimpleNamespace
from typing import Any

from helpers import need_ros
import pytest
from somfusion_ros.node_config import SlamNodeConfig

need_ros()

from geometry_msgs.msg import (Quaternion, Transform, TransformStamped,  # noqa: E402, I100
                               Vector3)
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.clock import Clock  # noqa: E402
from somfusion_ros.ros.common.tf import Mounts  # noqa: E402
from somfusion_ros.ros.slam.odometry_input import OdometryInput  # noqa: E402
from somfusion_ros.ros.slam.sources import hint  # noqa: E402
from std_msgs.msg import Header  # noqa: E402

SCAN, ODOMETRY = 'sensor_msgs/msg/LaserScan', 'nav_msgs/msg/Odometry'
JOINTS = 'sensor_msgs/msg/JointState'


class Node:
    """A node in /robot1 that sees topics (name: type) which somebody publishes."""

    def __init__(self, published: dict[str, str]) -> None:
        self._published = published
        self.callbacks: dict[str, Any] = {}

    def resolve_topic_name(self, name: str) -> str:
        """Resolve a name."""
        return name if name.startswith('/') else f'/robot1/{name}'

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        """Return who publishes."""
        return [SimpleNamespace(topic_type=kind) for name, kind in self._published.items()
                if name == topic]

    def get_topic_names_and_types(self) -> list[Any]:
        """Return all topics, also those that are only listened to."""
        return [('/robot1/scan', [SCAN]), *((n, [kind]) for n, kind in self._published.items())]

    def count_publishers(self, topic: str) -> int:
        """Count who publishes."""
        return len(self.get_publishers_info_by_topic(self.resolve_topic_name(topic)))

    def get_namespace(self) -> str:
        """Return the namespace."""
        return '/robot1'

    def create_subscription(self, kind: Any, topic: str, callback: Any, *_: Any, **__: Any) -> Any:
        """Keep who listens."""
        self.callbacks[topic] = callback
        return SimpleNamespace(topic_name=self.resolve_topic_name(topic))

    def get_clock(self) -> Clock:
        """Return a clock."""
        return Clock()

    def destroy_subscription(self, *_: Any) -> None:
        """Forget nothing."""


@pytest.mark.parametrize(('published', 'kind', 'source', 'words'), [
    ({'/robto1/scan': SCAN}, 'scan', 'auto',
     ': nobody publishes /robot1/scan; scans are on /robto1/scan'),
    ({'/robot0/scan': SCAN, '/robot1/front/scan': SCAN}, 'scan', 'auto',
     ': nobody publishes /robot1/scan; scans are on /robot1/front/scan, /robot0/scan'),
    ({'/robot1/clusters': 'sensor_msgs/msg/PointCloud2'}, 'scan', 'auto',
     ': nobody publishes /robot1/scan'),
    ({}, 'scan', 'auto', ': nobody publishes /robot1/scan'),
    ({'/robot1/scan': SCAN}, 'scan', 'auto', ''),
    ({'/robot1/scan': 'sensor_msgs/msg/Range'}, 'scan', 'auto',
     ': /robot1/scan is sensor_msgs/msg/Range, which is not read'),
    ({'/robot1/wheel/odom': ODOMETRY}, 'odometry', 'odom',
     ': nobody publishes /robot1/odom; odometry is on /robot1/wheel/odom'),
    ({'/robot1/joint_states': JOINTS}, 'odometry', 'auto', ': nobody publishes /robot1/odom; for '
     'wheel encoders on joint_states set odometry_source: encoders'),
    ({'/joint_states': JOINTS}, 'odometry', 'encoders',
     ': nobody publishes /robot1/joint_states; joint states are on /joint_states'),
    ({}, 'odometry', 'tf', ''), ({}, 'mount', 'auto', '')])
def test_why_nothing_is_heard_is_told(published: dict[str, str], kind: str, source: str,
                                      words: str) -> None:
    config = SlamNodeConfig(odometry_source=source)
    assert hint(Node(published), config, f'seconds_without_{kind}') == words


@pytest.mark.parametrize(('frame', 'differs'), [
    ('odom', False), ('/odom', False), ('robot1/odom', False), ('robot1_odom', False),
    ('', False), ('odom_combined', True), ('wheel_odom', True)])
def test_odometry_in_another_frame_is_counted_once(frame: str, differs: bool) -> None:
    node, counted = Node({}), []
    OdometryInput(node, SlamNodeConfig(odometry_source='odom'), lambda *_: None,
                  lambda *_: None, lambda kind, reason='', *_: counted.append((kind, reason)))
    for second in (1, 2):
        message = Odometry(header=Header(frame_id=frame))
        message.header.stamp.sec = second
        node.callbacks['odom'](message)
    assert [kind for kind, _ in counted] == ['odom_frame_differs'] * differs
    if differs:
        assert f'set odom_frame: {frame}' in counted[0][1]


def transform(place: float, **rotation: float) -> Any:
    """Say on tf_static where the laser sits."""
    return SimpleNamespace(transforms=[TransformStamped(
        header=Header(frame_id='base_link'), child_frame_id='laser', transform=Transform(
            translation=Vector3(x=place), rotation=Quaternion(**rotation)))])


def test_a_given_mount_that_tf_contradicts_is_counted_once() -> None:
    node, counted = Node({}), []
    mounts = Mounts(node, (0.2, 0.0, 0.0), lambda kind, reason='', *_: counted.append(reason))

    def find() -> None:
        assert mounts.find('base_link', 'laser').T_base_laser == (0.2, 0.0, 0.0)
    find()
    node.callbacks['/tf_static'](transform(0.2, w=1.0))
    find()
    assert not counted
    node.callbacks['/tf_static'](transform(0.2, x=1.0, w=0.0))
    find()
    find()
    assert [reason for reason in counted if 'upside down' in reason] == counted[-1:]
