# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics of the elastic map: `views`, from every slam_node, and `team/bonds`.

`views` is a log: every message is kept for late joiners, so that the middleware itself sends each
robot what it lacks, by number, once, also after a partition. It is heard only of robots whose
maps are of use.
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from nav_msgs.msg import Path
import numpy as np
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import path_message, pose_from_message
from somfusion_ros.ros.fusion.team_messages import bytes_from_message, bytes_message
from somfusion_ros.team.bond_message import BondTeller
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.view_inbox import ViewInbox
from std_msgs.msg import UInt8MultiArray


class ViewLink:
    """
    One robot's end of the elastic map; prefix: where its topics for the team stand.

    start: the session, as its states name it. Where the topics are not in the namespace, what
    slam_node tells of its path is told there again.
    """

    def __init__(self, node: Any, prefix: str, robot: str, session: FusionSession,
                 inbox: ViewInbox, count: Callable[..., None], start: str) -> None:
        self._node, self._session, self._inbox, self._count = node, session, inbox, count
        self._wanted: dict[str, list[Any]] = {}
        self._teller = BondTeller(start)
        self._bonds = node.create_publisher(UInt8MultiArray, f'{prefix}{names.TEAM_BONDS}',
                                            qos.LATCHED)
        own = node.create_subscription(UInt8MultiArray, names.VIEWS,
                                       partial(self._on_own_views, robot), qos.LOG)
        there = f'{prefix}{names.VIEWS}'
        self._retold = (node.create_publisher(UInt8MultiArray, there, qos.LOG)
                        if prefix and own.topic_name != there else None)
        node.create_subscription(Path, names.PATH, self._on_path, qos.LATEST)
        self._joint = node.create_publisher(Path, names.JOINT_PATH, qos.LATCHED)
        self._joint_said: Any = None

    def want(self, peers: Collection[str], heard: Collection[str]) -> None:
        """Listen to the views and the bonds of some peers, as long as these are heard at all."""
        for peer in self._wanted.keys() - set(heard):
            for subscription in self._wanted.pop(peer):
                self._node.destroy_subscription(subscription)
        for peer in set(peers) - self._wanted.keys():
            self._wanted[peer] = [
                self._node.create_subscription(UInt8MultiArray, f'/{peer}/{names.VIEWS}',
                                               partial(self._on_views, peer), qos.LOG),
                self._node.create_subscription(UInt8MultiArray, f'/{peer}/{names.TEAM_BONDS}',
                                               partial(self._on_bonds, peer), qos.LATCHED)]

    def say(self) -> None:
        """Publish the bonds that this robot tells, where they changed."""
        data = self._teller.more(self._session.elastic.own_bonds())
        if data is not None:
            self._bonds.publish(bytes_message(data))

    def say_joint(self, frame: str) -> None:
        """Publish where the own views are shown in the world, where somebody uses that."""
        path = self._session.elastic.own_path()
        if (path is not None and path[1] is not self._joint_said
                and self._joint.get_subscription_count()):
            self._joint_said = path[1]
            self._joint.publish(path_message(*path, frame, self._node.get_clock().now().to_msg()))

    def _on_own_views(self, robot: str, message: UInt8MultiArray) -> None:
        """Keep what the own slam_node tells; tell it again where the others look for it."""
        self._on_views(robot, message)
        if self._retold is not None:
            self._retold.publish(message)

    def _on_views(self, robot: str, message: UInt8MultiArray) -> None:
        """Keep what a robot tells of its path."""
        self._inbox.keep_batch(robot, bytes_from_message(message))

    def _on_bonds(self, robot: str, message: UInt8MultiArray) -> None:
        """Keep the bonds that a peer tells."""
        self._inbox.keep_bonds(robot, bytes_from_message(message))

    def _on_path(self, message: Path) -> None:
        """Note where the robot's own views lie in its own map now."""
        try:
            poses = [pose_from_message(item.pose) for item in message.poses]
        except ValueError as error:
            self._count('path_unusable', str(error))
            return
        self._session.path = np.array(poses, dtype=float).reshape(-1, 3)
