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
from secrets import token_bytes
from typing import Any
from uuid import uuid4

from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import pose_with_covariance, time_message
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.team_messages import bytes_message
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, MAP
from somfusion_ros.team.ed25519 import KEY
from somfusion_ros.team.heard import TimedPose
from somfusion_ros.team.outbox import Outbox
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.state_codec import decode_state
from std_msgs.msg import String, UInt8MultiArray

STREAMS = {MAP: names.TEAM_MAP, CHANGES: names.TEAM_MAP_CHANGES}


class TeamLink:
    """One robot's end of all links; prefix: where its topics for the team stand."""

    def __init__(self, node: Any, prefix: str, receiver: Receiver,
                 count: Callable[..., None]) -> None:
        self._node, self._receiver, self._count = node, receiver, count
        self._outbox = Outbox(uuid4().hex[:12], receiver.inbox.name, token_bytes(KEY))
        self._epoch: Epoch | None = None
        self._since = 0
        self._wanted: set[str] = set()
        self._subscriptions: dict[str, list[Any]] = {}
        self._clusters: dict[str, Any] = {}
        self._state = node.create_publisher(String, f'{prefix}{names.TEAM_STATE}', qos.LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped,
                                           f'{prefix}{names.TEAM_POSE}', qos.LATCHED)
        self._streams = {channel: node.create_publisher(
            UInt8MultiArray, f'{prefix}{topic}', qos.LATCHED)
            for channel, topic in STREAMS.items()}
        node.create_subscription(String, f'{prefix}{names.TEAM_STATE}', self._on_own_state,
                                 qos.LATCHED)

    @property
    def start(self) -> str:
        """The session in which this node speaks."""
        return self._outbox.session

    @property
    def shares(self) -> bool:
        """Whether the robot's map was told in this session."""
        return self._epoch is not None

    def listen(self, peer: str) -> None:
        """Subscribe to what a peer publishes always."""
        on = self._receiver
        self._subscribe(String, peer, names.TEAM_STATE, on.on_state)
        self._clusters[peer] = self._subscribe(PointCloud2, peer, names.CLUSTERS, on.on_clusters)
        self._subscribe(PoseWithCovarianceStamped, peer, names.TEAM_POSE, on.on_team_pose)

    def forget(self, peer: str) -> None:
        """Subscribe to nothing of a peer any more."""
        for subscription in self._subscriptions.pop(peer, ()):
            self._node.destroy_subscription(subscription)
        self._clusters.pop(peer, None)
        self._wanted.discard(peer)

    def want(self, peers: Collection[str]) -> None:
        """Subscribe to the maps of some peers, in place of their clusters."""
        for peer in set(peers) - self._wanted:
            self._wanted.add(peer)
            clusters = self._clusters.pop(peer)
            self._subscriptions[peer].remove(clusters)
            self._node.destroy_subscription(clusters)
            for channel, topic in STREAMS.items():
                self._subscribe(UInt8MultiArray, peer, topic,
                                partial(self._receiver.on_bytes, channel=channel))

    def say(self, snapshot: Snapshot, now: float) -> None:
        """Publish what the robot accepts, where it changed or a heartbeat is due."""
        self._since = min(self._since, self._node.get_clock().now().nanoseconds)   # time may jump
        text = self._outbox.state(snapshot, self._since, now)
        if text is not None:
            self._state.publish(String(data=text))

    def tell_pose(self, here: TimedPose, frame: str) -> None:
        """Publish where the robot is, and in which map, if it moved."""
        if self._epoch is not None and self._outbox.moved(here):
            self._pose.publish(pose_with_covariance(
                here.pose, here.covariance, f'{frame}@{self._epoch}', time_message(here.stamp)))

    def share(self, cells: MapCells, epoch: Epoch) -> None:
        """Keep the robot's newest map, before its clusters are published."""
        if epoch != self._epoch:
            self._epoch, self._since = epoch, self._node.get_clock().now().nanoseconds
        self._outbox.share(cells, epoch)

    def flush(self) -> None:
        """Send the map, or what changed of it, where somebody listens and has not got it yet."""
        if self._streams[MAP].get_subscription_count():
            for channel, data in self._outbox.map_messages():
                self._streams[channel].publish(bytes_message(data))

    def _subscribe(self, kind: type, peer: str, topic: str, callback: Callable[..., None]) -> Any:
        """Subscribe to one topic of a peer."""
        made = self._node.create_subscription(kind, f'/{peer}/{topic}', partial(callback, peer),
                                              qos.LATCHED)
        self._subscriptions.setdefault(peer, []).append(made)
        return made

    def _on_own_state(self, message: String) -> None:
        """Notice another robot under this one's name."""
        try:
            taken = decode_state(message.data).session != self._outbox.session
        except ValueError:
            taken = True
        if taken:
            self._count('name_taken', "another robot speaks under this one's name; give it "
                        'another namespace')
