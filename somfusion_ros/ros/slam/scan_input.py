# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a slam_node's scans come from: one laser or several, and what type their messages have."""

from collections.abc import Callable, Sequence
from typing import Any

from sensor_msgs.msg import LaserScan, MultiEchoLaserScan, PointCloud2
from somfusion_ros.ros.common import qos

KINDS = {'sensor_msgs/msg/LaserScan': LaserScan,   # the first that is found is taken
         'sensor_msgs/msg/MultiEchoLaserScan': MultiEchoLaserScan,
         'sensor_msgs/msg/PointCloud2': PointCloud2}


class ScanInput:
    """
    Hears lasers and hands their messages on as `take(message, laser)`; laser: name of the topic.

    Each topic is listened to as LaserScan, until somebody publishes another type there. What take
    refuses by a ValueError is counted.
    """

    def __init__(self, node: Any, topics: Sequence[str], take: Callable[[Any, str], None],
                 count: Callable[..., None]) -> None:
        self._node, self._take, self._count = node, take, count
        self._heard = {topic: self._listen(topic, 'sensor_msgs/msg/LaserScan')
                       for topic in topics}

    @property
    def topic(self) -> str:
        """Names of the topics, with commas between."""
        return ', '.join(listener.topic_name for _, listener in self._heard.values())

    def look(self) -> None:
        """Look which types are published, and listen to those."""
        for topic, (kind, listener) in self._heard.items():
            told = {info.topic_type for info in
                    self._node.get_publishers_info_by_topic(listener.topic_name)}
            found = next((known for known in KINDS if known in told), kind)
            if found != kind and kind not in told:
                self._node.get_logger().info(f'{listener.topic_name} is a {found}: it is read')
                self._node.destroy_subscription(listener)
                self._heard[topic] = self._listen(topic, found)

    def _listen(self, topic: str, kind: str) -> tuple[str, Any]:
        """Subscribe to a topic; return the type and the subscription."""
        return kind, self._node.create_subscription(
            KINDS[kind], topic, lambda message: self._hand_on(message, topic), qos.SENSOR_DATA,
            qos_overriding_options=qos.overridable())

    def _hand_on(self, message: Any, topic: str) -> None:
        """Hand on a message, if it can be used."""
        try:
            self._take(message, topic)
        except ValueError as error:
            self._count('scans_unusable', str(error))
