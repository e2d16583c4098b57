# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot's own map, from its slam_node or from any other SLAM."""

from collections.abc import Callable
from typing import Any

from nav_msgs.msg import OccupancyGrid
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import names, qos


class OwnMap:
    """
    Hears the robot's own map and hands on what is new.

    Where the SLAM publishes graded evidence beside it, as slam_node does, that is used: a wall
    that was seen often counts for more.
    """

    def __init__(self, node: Any, config: FusionNodeConfig, keep: Callable[[Any], None],
                 count: Callable[..., None]) -> None:
        self._node, self._frame, self._keep, self._count = node, config.map_frame, keep, count
        self._last: OccupancyGrid | None = None
        self._graded = node.resolve_topic_name(
            f'{config.robot_map_topic}{names.GRADED_SUFFIX}')
        node.create_subscription(OccupancyGrid, config.robot_map_topic, self._on_plain,
                                 qos.LATCHED)
        node.create_subscription(OccupancyGrid, self._graded, self._on_map, qos.LATCHED)

    def _on_plain(self, message: OccupancyGrid) -> None:
        """Use a map unless its graded form comes as well."""
        if not self._node.count_publishers(self._graded):
            self._on_map(message)

    def _on_map(self, message: OccupancyGrid) -> None:
        """Hand on a map unless it is the last one again; SLAMs repeat their maps."""
        frame = message.header.frame_id
        if frame.strip('/') != self._frame.strip('/'):
            self._count('map_frame_differs', f'the map on {self._node.get_namespace()} is in the '
                        f'frame {frame!r}, but map_frame is {self._frame!r}, which world -> map '
                        f'leads to: set map_frame to {frame!r}')
        last = self._last
        if (last is None or last.info != message.info
                or memoryview(last.data).tobytes() != memoryview(message.data).tobytes()):
            self._last = message
            self._keep(message)
