# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sightings of peers, which wait for a moment until both robots' poses at that time are known."""

from collections import deque
from collections.abc import Callable, Mapping
import time
from typing import NamedTuple

from geometry_msgs.msg import PoseWithCovarianceStamped
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common.heard import from_sighting, Heard
from somfusion_ros.team.graph import Edge

PATIENCE = 3.0    # [s] that a sighting waits for newer poses
KEPT = 50         # sightings that wait at most


class Sighting(NamedTuple):
    """A peer in the robot's own base frame, seen at a stamp [s], heard at a time [s]."""

    peer: str
    stamp: float
    T_base_peer: Pose
    covariance: Array
    heard: float


class Sightings:
    """Turns sightings into edges between the two robots' maps."""

    def __init__(self, name: str, heard: Mapping[str, Heard], take: Callable[[Edge], object],
                 count: Callable[..., None]) -> None:
        self._name, self._heard, self._take, self._count = name, heard, take, count
        self._waiting: deque[Sighting] = deque(maxlen=KEPT)

    def add(self, message: PoseWithCovarianceStamped) -> None:
        """Keep a sighting: header.frame_id names the peer."""
        try:
            self._waiting.append(Sighting(
                message.header.frame_id.strip('/'), convert.seconds(message.header.stamp),
                convert.pose_from_message(message.pose.pose),
                convert.usable_covariance(message.pose.covariance), time.monotonic()))
        except ValueError as error:
            self._count('encounters_unusable', str(error))

    def settle(self) -> None:
        """Use those whose poses are known, and give up those that waited too long."""
        for _ in range(len(self._waiting)):
            sighting = self._waiting.popleft()
            pair = [self._heard.get(robot) for robot in (self._name, sighting.peer)]
            known = all(heard and heard.knows(sighting.stamp) for heard in pair)
            if not known and time.monotonic() - sighting.heard < PATIENCE:
                self._waiting.append(sighting)
                continue
            own, peer = (heard and heard.pose_at(sighting.stamp) for heard in pair)
            if own and peer and sighting.peer != self._name:
                self._take(Edge(self._name, sighting.peer, *from_sighting(
                    own, sighting.T_base_peer, sighting.covariance, peer), kind='sighting'))
            else:
                self._count('encounters_unusable', f'no pose of {self._name} or of '
                            f'{sighting.peer!r} at {sighting.stamp:.3f} s')
