# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Finds the robots around, and listens to them as they speak.

A robot with a fusion node of this package tells little and sends its map when that is of use. Of
any other robot, whatever SLAM it runs, the whole nav_msgs/OccupancyGrid is heard.
"""

from collections import Counter
from functools import partial
from hashlib import blake2b
import time
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.peers import find_peers
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.team_link import TeamLink
from somfusion_ros.team.heard import Heard
from std_msgs.msg import String

SILENT_LOOKS = 3   # in a row after which nobody is taken to tell which map it publishes
MOST_PEERS = 64    # robots that are listened to; a flood of names must not fill the memory


class Discovery:
    """
    Subscribes to each robot once, and again when it turns out to have a fusion node.

    teams: robots with a fusion node, now or once; alive: those whose fusion node is there now;
    present: those that are there now, with or without one; looks: how often was looked. prefix:
    where the robot's own topics for the team stand.
    """

    def __init__(self, node: Any, prefix: str, config: FusionNodeConfig, link: TeamLink,
                 receiver: Receiver) -> None:
        self._node, self._config, self._link, self._receiver = node, config, link, receiver
        self._heard = receiver.inbox.heard
        self._own_map = node.resolve_topic_name(config.robot_map_topic)
        self._own_epoch = node.resolve_topic_name(names.MAP_EPOCH)
        self._publishers: dict[str, str] = {}
        self._silent: Counter[str] = Counter()
        self._own_state = node.resolve_topic_name(f'{prefix}{names.TEAM_STATE}')
        self._first_seen: dict[str, float] = {}
        self._present_at: dict[str, float] = {}
        self._plain: dict[str, list[Any]] = {}
        self.looks = 0
        self.teams: set[str] = set()
        self.alive: set[str] = set()
        self.present: set[str] = set()

    def look(self) -> None:
        """Listen to every robot that is new."""
        self.looks += 1
        topics, peers = self._node.get_topic_names_and_types(), self._config.peers
        teams = find_peers(topics, names.TEAM_STATE, names.STATE_TYPE, self._own_state, peers)
        for peer in teams:
            if peer not in self.teams and self._node.count_publishers(
                    f'/{peer}/{names.TEAM_STATE}') and self._room_for(peer):
                self._listen_to_team(peer)
        now = time.monotonic()
        plain = find_peers(topics, self._config.robot_map_topic, names.MAP_TYPE, self._own_map,
                           peers)
        self._first_seen = {peer: self._first_seen.get(peer, now) for peer in plain}
        for peer, first in self._first_seen.items():
            new = peer not in self.teams and peer not in self._plain
            if new and now - first >= self._config.plain_map_delay and self._room_for(peer):
                self._listen_to_plain(peer)
        self._look_at_slams()
        self.alive = self._publishing(names.RELATIVE_TRANSFORMS)
        self.present = self._publishing(self._config.robot_map_topic)
        self._present_at |= dict.fromkeys(self.present, now)

    def _publishing(self, plain_topic: str) -> set[str]:
        """Name robots that publish a state, or a plain topic where they have no fusion node."""
        return {peer for peer in self._heard if self._node.count_publishers(
            f'/{peer}/{names.TEAM_STATE if peer in self.teams else plain_topic}')}

    def _look_at_slams(self) -> None:
        """Note who publishes the maps that come without a fusion node, and who tells epochs."""
        node, inbox = self._node, self._receiver.inbox
        plain, name = inbox.plain, inbox.name
        for robot in [name, *self._plain]:
            own = robot == name
            topic = self._own_map if own else f'/{robot}/{self._config.robot_map_topic}'
            word = self._own_epoch if own else f'/{robot}/{names.MAP_EPOCH}'
            self._silent[robot] = 0 if node.count_publishers(word) else self._silent[robot] + 1
            if self._silent[robot] >= SILENT_LOOKS:
                plain.untell(robot)
            found = sorted(start_of(info) for info in node.get_publishers_info_by_topic(topic))
            if found and self._publishers.get(robot) not in found:
                self._publishers[robot] = found[0]
                plain.publisher(robot, found[0])

    def _room_for(self, peer: str) -> bool:
        """Return whether a robot may be listened to; who is gone for longest makes room."""
        if peer in self._heard or len(self._heard) <= MOST_PEERS:
            return True
        gone = self._heard.keys() - self.present - {self._receiver.inbox.name}
        if not gone:
            return False
        self._forget(min(gone, key=lambda one: (self._present_at.get(one, 0.0), one)))
        return True

    def _forget(self, peer: str) -> None:
        """Listen to a robot no more; what the team knows of it is the team's affair."""
        for subscription in self._plain.pop(peer, ()):
            self._node.destroy_subscription(subscription)
        self._link.forget(peer)
        self._receiver.inbox.forget(peer)
        for known in (self._present_at, self._publishers, self._silent):
            known.pop(peer, None)
        self.teams.discard(peer)

    def _listen_to_team(self, peer: str) -> None:
        """Subscribe to what a robot with a fusion node publishes always."""
        for subscription in self._plain.pop(peer, ()):
            self._node.destroy_subscription(subscription)
        self._say(peer, 'a fusion node')
        self.teams.add(peer)
        self._link.listen(peer)

    def _listen_to_plain(self, peer: str) -> None:
        """Subscribe to the whole maps of a robot without a fusion node."""
        self._say(peer, 'whole maps')
        node, receiver, topic = self._node, self._receiver, self._config.robot_map_topic
        self._plain[peer] = [
            node.create_subscription(OccupancyGrid, f'/{peer}/{topic}',
                                     partial(receiver.on_map, peer), qos.LATCHED),
            node.create_subscription(PoseWithCovarianceStamped, f'/{peer}/{names.ROBOT_POSE}',
                                     partial(receiver.on_pose, peer), qos.STREAM),
            node.create_subscription(TransformStamped, f'/{peer}/{names.RELATIVE_TRANSFORMS}',
                                     partial(receiver.on_transform, peer),
                                     qos.LATCHED_PER_PAIR),
            node.create_subscription(String, f'/{peer}/{names.MAP_EPOCH}',
                                     partial(receiver.on_epoch, peer), qos.LATCHED)]

    def _say(self, peer: str, how: str) -> None:
        """Log a robot that is heard from now on."""
        self._heard.setdefault(peer, Heard())
        self._node.get_logger().info(f'found {peer}, with {how}')


def start_of(publisher: Any) -> str:
    """Return a word for a publisher that no other has, from its identifier in the middleware."""
    return blake2b(bytes(publisher.endpoint_gid), digest_size=6).hexdigest()
