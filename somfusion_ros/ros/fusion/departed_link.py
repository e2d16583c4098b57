# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hands maps of robots that are gone on to those who are left: `team/departed/<robot>`."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.team_messages import bytes_message
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import MAP
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.map_codec import key_message
from somfusion_ros.team.shared_map import SharedMap
from std_msgs.msg import UInt8MultiArray


class DepartedLink:
    """One robot's end of the links on which maps of absent robots go."""

    def __init__(self, node: Any, prefix: str, receiver: Receiver) -> None:
        self._node, self._prefix, self._receiver = node, prefix, receiver
        self._offered: dict[str, Any] = {}
        self._sent: dict[str, SharedMap] = {}
        self._fetched: dict[str, tuple[str, Any]] = {}

    def offer(self, maps: Mapping[str, SharedMap], epochs: Mapping[str, Epoch]) -> None:
        """Hand maps of absent robots to those who ask; what is back speaks for itself again."""
        for robot in self._offered.keys() - maps.keys():
            self._node.destroy_publisher(self._offered.pop(robot))
            self._sent.pop(robot, None)
        for robot, shared in maps.items():
            if robot not in self._offered:
                self._offered[robot] = self._node.create_publisher(
                    UInt8MultiArray, f'{self._prefix}{names.TEAM_DEPARTED}/{robot}', qos.LATCHED)
            publisher = self._offered[robot]
            if publisher.get_subscription_count() and self._sent.get(robot) is not shared:
                self._sent[robot] = shared
                publisher.publish(bytes_message(key_message(shared.to_cells(), epochs[robot])))

    def fetch(self, sources: Mapping[str, str]) -> None:
        """Ask for maps of absent robots, each from the peer that is named for it."""
        for robot in list(self._fetched):
            if self._fetched[robot][0] != sources.get(robot):
                self._node.destroy_subscription(self._fetched.pop(robot)[1])
        for robot, keeper in sources.items():
            if robot not in self._fetched:
                self._receiver.inbox.heard.setdefault(robot, Heard())
                self._fetched[robot] = keeper, self._node.create_subscription(
                    UInt8MultiArray, f'/{keeper}/{names.TEAM_DEPARTED}/{robot}',
                    partial(self._receiver.on_bytes, robot, channel=MAP), qos.LATCHED)
