# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`world -> map` and `world -> <peer>/map` on TF, at the rate and tolerance of map -> odom."""

from collections.abc import Collection
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common.tf import Broadcaster
from somfusion_ros.ros.fusion.frames import Frames
from somfusion_ros.team.snapshot import Snapshot


class WorldTransforms:
    """
    Repeats where the maps lie, dated ahead.

    Whoever navigates in `world` asks for the present and does not wait; a transform that was sent
    when it last changed would be too old.
    """

    def __init__(self, node: Any, frames: Frames, config: FusionNodeConfig) -> None:
        self._node, self._frames, self._config = node, frames, config
        self._broadcaster = Broadcaster(node)
        self._ahead = Duration(seconds=config.transform_timeout)
        self._transforms: list[TransformStamped] = []
        self.period = config.transform_publish_period if self._broadcaster.available else 0.0

    def place(self, snapshot: Snapshot, alive: Collection[str], looked_around: bool) -> None:
        """
        Take where the maps lie now.

        In one tree for all robots, a peer whose own fusion node is alive places its map itself;
        and of the robots that are not connected only one may stand at the origin of `world`, once
        it has looked around for others.
        """
        own, shared = self._frames.robot, self._frames.shared
        placed = snapshot.world(own)
        first = snapshot.anchor or min({own, *alive})
        if shared and len(placed) == 1 and not (looked_around and own == first):
            placed = {}
        self._transforms = [
            convert.transform_message(pose, self._frames.world, self._frames.map_of(robot),
                                      convert.time_message(0.0))
            for robot, pose in placed.items()
            if robot == own or not shared or robot not in alive]

    def send(self) -> None:
        """Broadcast all of them as true from now on for a moment."""
        stamp = (self._node.get_clock().now() + self._ahead).to_msg()
        transforms = self._transforms
        for transform in transforms:
            transform.header.stamp = stamp
        self._broadcaster.send(transforms)
