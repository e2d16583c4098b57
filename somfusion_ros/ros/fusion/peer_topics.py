# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What peers have seen, for RViz and Foxglove in this robot's tree: `peers/<robot>/...`.

A peer's own topics carry its own frame `map`, which in this tree is another robot's. Here the
same things carry `<robot>/map`, which this tree has once the peer is connected. All is published
only while somebody looks.
"""

from collections.abc import Mapping
from threading import Lock
from typing import Any

from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.io.cluster_rows import cluster_rows
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.fusion.frames import Frames
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.screening import outline
from somfusion_ros.team.session import FusionSession

KINDS = {names.MAP: OccupancyGrid, names.PATH: Path, names.CLUSTERS: PointCloud2}


class PeerTopics:
    """Publishers of maps, paths and clusters of the connected peers, by peer and topic."""

    def __init__(self, node: Any, frames: Frames, session: FusionSession,
                 heard: Mapping[str, Heard]) -> None:
        self._node, self._frames, self._session, self._heard = node, frames, session, heard
        self._publishers: dict[tuple[str, str], Any] = {}
        self._shown: dict[tuple[str, str], Any] = {}
        self._lock = Lock()     # of the publishers: they go in another thread than they are used

    def offer(self, peers: list[str]) -> None:
        """Make topics for the peers that are connected now; those of others go."""
        for key in [key for key in self._publishers if key[0] not in peers]:
            with self._lock:
                self._node.destroy_publisher(self._publishers.pop(key))
                self._shown.pop(key, None)
        for peer in peers:
            for topic, kind in KINDS.items():
                if peer != self._frames.robot and (peer, topic) not in self._publishers:
                    self._publishers[peer, topic] = self._node.create_publisher(
                        kind, f'{names.PEERS}/{peer}/{topic}', qos.LATCHED)

    def publish(self) -> None:
        """Publish what changed and what somebody began to look at."""
        maps = self._session.shown_maps()
        for peer, topic in list(self._publishers):
            shared = maps.get(peer)
            newest = self._last_place(peer) if topic == names.PATH else shared
            with self._lock:
                publisher = self._publishers.get((peer, topic))
                if publisher is None:
                    continue
                looking = publisher.get_subscription_count()
                last_looking, last = self._shown.get((peer, topic), (0, None))
                if looking and newest and (looking > last_looking or newest is not last):
                    publisher.publish(self._message(peer, topic, shared))
                    last = newest
                self._shown[peer, topic] = looking, last

    def _last_place(self, peer: str) -> tuple[float, float] | None:
        """Return the newest place on a peer's way, the same object until there is another."""
        heard = self._heard.get(peer)
        return next(iter(tuple(heard.trail)[-1:]), None) if heard is not None else None

    def _message(self, peer: str, topic: str, shared: Any) -> Any:
        """Convert one thing that a peer has seen, in the peer's frame of this tree."""
        stamp, frame = self._node.get_clock().now().to_msg(), self._frames.map_of(peer)
        if topic == names.MAP:
            return convert.grid_message(shared.grid, frame, stamp)
        if topic == names.CLUSTERS:
            rows = cluster_rows(outline(self._session.learned_of(peer)))
            return convert.cluster_cloud(rows, frame, stamp)
        heard = self._heard.get(peer)
        trail = np.reshape([] if heard is None else heard.trail, (-1, 2))
        poses = np.column_stack([trail, np.zeros(len(trail))])
        return convert.path_message(np.full(len(trail), convert.seconds(stamp)), poses, frame,
                                    stamp)
