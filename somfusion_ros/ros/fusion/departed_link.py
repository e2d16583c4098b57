# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Hands on what robots that are gone have told, to those who are left and those who come later.

Their maps go on `team/departed/<robot>`, their views and bonds on `team/departed_views/<robot>`.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.team_messages import bytes_from_message, bytes_message
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.elastic_session import ElasticSession
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.map_codec import key_message
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.view_inbox import ViewInbox
from std_msgs.msg import UInt8MultiArray


class DepartedLink:
    """One robot's end of the links on which maps and views of absent robots go."""

    def __init__(self, node: Any, prefix: str, receiver: Receiver, elastic: ElasticSession,
                 views: ViewInbox) -> None:
        self._node, self._prefix, self._receiver = node, prefix, receiver
        self._elastic, self._views = elastic, views
        self._offered: dict[str, tuple[Any, Any]] = {}    # publishers of map and views
        self._sent: dict[str, SharedMap] = {}
        self._told: dict[str, bytes] = {}
        self._fetched: dict[str, tuple[str, list[Any]]] = {}
        self._came: set[str] = set()     # robots whose views were handed on

    def offer(self, maps: Mapping[str, SharedMap], epochs: Mapping[str, Epoch]) -> None:
        """Hand maps of absent robots to those who ask; what is back speaks for itself again."""
        for robot in self._offered.keys() - maps.keys():
            for publisher in self._offered.pop(robot):
                self._node.destroy_publisher(publisher)
            self._sent.pop(robot, None)
            self._told.pop(robot, None)
        for robot, shared in maps.items():
            if robot not in self._offered:
                self._offered[robot] = (self._publisher(names.TEAM_DEPARTED, robot),
                                        self._publisher(names.TEAM_DEPARTED_VIEWS, robot))
            publisher, views = self._offered[robot]
            if publisher.get_subscription_count() and self._sent.get(robot) is not shared:
                self._sent[robot] = shared
                publisher.publish(bytes_message(key_message(shared.to_cells(), epochs[robot])))
            if views.get_subscription_count():
                kept = self._elastic.kept(robot)
                if kept and kept != self._told.get(robot):
                    self._told[robot] = kept
                    views.publish(bytes_message(kept))

    def _publisher(self, topic: str, robot: str) -> Any:
        """Make a publisher for those who ask about an absent robot."""
        return self._node.create_publisher(UInt8MultiArray, f'{self._prefix}{topic}/{robot}',
                                           qos.LATCHED)

    def fetch(self, sources: Mapping[str, str], absent: Collection[str]) -> None:
        """
        Ask for maps and views of absent robots, each from the peer that is named for it.

        None is named once the map is here; the views are larger, and may come later.
        """
        for robot, (keeper, subscriptions) in list(self._fetched.items()):
            waits = robot in absent and robot not in sources and robot not in self._came
            if keeper != sources.get(robot) and not waits:
                for subscription in subscriptions:
                    self._node.destroy_subscription(subscription)
                del self._fetched[robot]
                self._came.discard(robot)
        for robot, keeper in sources.items():
            if robot not in self._fetched:
                self._receiver.inbox.heard.setdefault(robot, Heard())
                self._fetched[robot] = keeper, [
                    self._subscription(keeper, names.TEAM_DEPARTED, robot,
                                       partial(self._receiver.on_lent_map, robot)),
                    self._subscription(keeper, names.TEAM_DEPARTED_VIEWS, robot,
                                       partial(self._on_views, robot))]

    def _subscription(self, keeper: str, topic: str, robot: str,
                      use: Callable[[UInt8MultiArray], None]) -> Any:
        """Listen to what a keeper hands on of an absent robot."""
        return self._node.create_subscription(UInt8MultiArray, f'/{keeper}/{topic}/{robot}', use,
                                              qos.LATCHED)

    def _on_views(self, robot: str, message: UInt8MultiArray) -> None:
        """Keep what an absent robot told of its path."""
        self._came.add(robot)
        self._views.keep_kept(robot, bytes_from_message(message))
