# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics by which fusion nodes talk to one another: `team/...` and `clusters`.

Every robot tells all others its state, its pose and the clusters of its map, which is little.
Its map is sent only while somebody listens to it, as a key and what changed since: a peer listens
once a match is likely. All of it is latched, so that a late joiner, or one that was out of reach,
gets what counts now and nothing else.
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import Any
from uuid import uuid4

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import pose_with_covariance, time_message
from somfusion_ros.ros.common.heard import TimedPose
from somfusion_ros.ros.fusion.inbox import Inbox
from somfusion_ros.ros.fusion.team_messages import (bytes_message, State, state_from_message,
                                                    state_message)
from somfusion_ros.team.departed import Kept
from somfusion_ros.team.graph import Edge
from somfusion_ros.team.map_codec import MapEncoder
from somfusion_ros.team.shared_map import Cells
from std_msgs.msg import String, UInt8MultiArray

HEARTBEAT = 10.0       # [s] after which a state is repeated though nothing changed
STOOD_STILL = 0.02     # [m, rad] below which a pose is not told again


class TeamLink:
    """One robot's end of all links."""

    def __init__(self, node: Any, inbox: Inbox, count: Callable[..., None]) -> None:
        self._node, self._inbox, self._count = node, inbox, count
        self._session = uuid4().hex[:12]
        self._encoder = MapEncoder()
        self._cells: Cells | None = None
        self._sent: dict[str, bytes | None] = {names.TEAM_MAP: None, names.TEAM_MAP_CHANGES: None}
        self._said: tuple[str, float] = '', 0.0
        self._told = np.full(3, np.inf)
        self._wanted: set[str] = set()
        self._clusters: dict[str, Any] = {}
        self._state = node.create_publisher(String, names.TEAM_STATE, qos.LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, names.TEAM_POSE, qos.LATCHED)
        self._streams = {topic: node.create_publisher(UInt8MultiArray, topic, qos.LATCHED)
                         for topic in (names.TEAM_MAP, names.TEAM_MAP_CHANGES)}
        node.create_subscription(String, names.TEAM_STATE, self._on_own_state, qos.LATCHED)

    def listen(self, peer: str) -> None:
        """Subscribe to what a peer publishes always."""
        self._subscribe(String, peer, names.TEAM_STATE)
        self._clusters[peer] = self._subscribe(PointCloud2, peer, names.CLUSTERS)
        self._node.create_subscription(PoseWithCovarianceStamped, f'/{peer}/{names.TEAM_POSE}',
                                       partial(self._inbox.keep_pose, peer), qos.LATCHED)

    def want(self, peers: Collection[str]) -> None:
        """Subscribe to the maps of some peers, in place of their clusters."""
        for peer in set(peers) - self._wanted:
            self._wanted.add(peer)
            self._node.destroy_subscription(self._clusters.pop(peer))
            for topic in (names.TEAM_MAP, names.TEAM_MAP_CHANGES):
                self._subscribe(UInt8MultiArray, peer, topic)

    def say(self, edges: Collection[Edge], kept: Collection[Kept], now: float) -> None:
        """Publish what the robot accepts and keeps, where it changed or a heartbeat is due."""
        message = state_message(State(self._session, tuple(edges), tuple(kept)))
        text, at = self._said
        if message.data != text or now - at >= HEARTBEAT:
            self._said = message.data, now
            self._state.publish(message)

    def tell_pose(self, here: TimedPose, frame: str) -> None:
        """Publish where the robot is, if it moved."""
        if np.abs(np.subtract(here.pose, self._told)).max() >= STOOD_STILL:
            self._told = np.array(here.pose)
            self._pose.publish(pose_with_covariance(here.pose, here.covariance, frame,
                                                    time_message(here.stamp)))

    def share(self, cells: Cells) -> None:
        """Keep the robot's newest map for those who ask for it."""
        self._cells = cells

    def flush(self) -> None:
        """Send the map, or what changed of it, where somebody listens and has not got it yet."""
        if not self._streams[names.TEAM_MAP].get_subscription_count():
            return
        if self._cells is not None:
            self._encoder.encode(self._cells)
            self._cells = None
        for topic, data in ((names.TEAM_MAP, self._encoder.key or None),
                            (names.TEAM_MAP_CHANGES, self._encoder.change)):
            if data is not None and data is not self._sent[topic]:
                self._sent[topic] = data
                self._streams[topic].publish(bytes_message(data))

    def _subscribe(self, kind: type, peer: str, topic: str) -> Any:
        """Subscribe to one topic of a peer."""
        return self._node.create_subscription(kind, f'/{peer}/{topic}', partial(
            self._inbox.keep, peer, topic), qos.LATCHED)

    def _on_own_state(self, message: String) -> None:
        """Notice another robot under this one's name."""
        try:
            taken = state_from_message(message).session != self._session
        except ValueError:
            taken = True
        if taken:
            self._count('name_taken', "another robot speaks under this one's name; give it "
                        'another namespace')
