# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot hears of another: who there is, when it was heard, where it was."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from somfusion_ros.geometry import compose, inverse, Pose

MAP_TYPE = 'nav_msgs/msg/OccupancyGrid'
POSES_KEPT = 200
SIGHTING_TOLERANCE = 0.5   # [s] between a sighting and the poses that it is tied to


def find_peers(topics: Iterable[tuple[str, list[str]]], map_topic: str, own_topic: str,
               wanted: Iterable[str]) -> list[str]:
    """
    Names of the robots that publish a map.

    Only topics of the exact type and last name count: never a peer's global_map or a costmap.

    Parameters
    ----------
    topics : names and types of all topics in the graph
    map_topic : last name of a robot's map topic
    own_topic : the robot's own map topic in full
    wanted : names to keep; none keeps all
    """
    wanted = {name.strip('/') for name in wanted if name.strip('/')}
    found = set()
    for topic, types in topics:
        name, _, last = topic.rpartition('/')
        if last == map_topic and MAP_TYPE in types and topic != own_topic and name:
            found.add(name.strip('/'))
    return sorted(found & wanted if wanted else found)


def robot_of(frame: str) -> str:
    """Name of the robot to which a map frame `<robot>/map` belongs."""
    return frame.strip('/').rpartition('/')[0]


@dataclass
class Heard:
    """What was heard of one robot: times [s] of a steady clock, bytes, and recent poses."""

    map_at: float = float('-inf')
    map_bytes: int = 0
    maps: int = 0
    poses: deque[tuple[float, Pose]] = field(default_factory=lambda: deque(maxlen=POSES_KEPT))

    def pose_at(self, stamp: float) -> Pose | None:
        """T_map_base nearest to a stamp [s]; None where none is near enough."""
        best = min(self.poses, key=lambda item: abs(item[0] - stamp), default=None)
        near = best is not None and abs(best[0] - stamp) <= SIGHTING_TOLERANCE
        return best[1] if near else None


def from_sighting(T_own_base: Pose, T_base_peer: Pose, T_peer_base: Pose) -> Pose:
    """T_own_peer of two map frames, from a sighting of the peer in the robot's own base frame."""
    T_own_peer = compose(compose(T_own_base, T_base_peer), inverse(T_peer_base))
    return Pose.from_array(np.asarray(T_own_peer))
