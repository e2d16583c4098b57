# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sightings of peers, which wait for a moment until both robots' poses at that time are known."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from somfusion_ros.geometry import Array, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.heard import from_sighting, Heard, same_time

WAITING = 50      # sightings that wait at most


@dataclass(frozen=True)
class SightingTuning:
    """How long a sighting waits."""

    patience: float = tuned(
        3.0, 's', 'a sighting waits this long for poses as new as it is; poses come every second',
        'by design')


TUNING = SightingTuning()


class Sighting(NamedTuple):
    """A peer in the robot's own base frame, seen at a stamp [s], heard of at a time [s]."""

    peer: str
    stamp: float
    T_base_peer: Pose
    covariance: Array
    heard_at: float


class Sightings:
    """Turns sightings into constraints between the two robots' maps."""

    def __init__(self, name: str, heard: Mapping[str, Heard],
                 take: Callable[[MapConstraint], object], count: Callable[..., None]) -> None:
        self._name, self._heard, self._take, self._count = name, heard, take, count
        self._waiting: deque[Sighting] = deque(maxlen=WAITING)

    def add(self, sighting: Sighting) -> None:
        """Let a sighting wait for its poses."""
        self._waiting.append(sighting)

    def settle(self, now: float) -> None:
        """Use those whose poses are known at a time [s], give up those that waited too long."""
        for _ in range(len(self._waiting)):
            sighting = self._waiting.popleft()
            pair = [self._heard.get(robot) for robot in (self._name, sighting.peer)]
            known = all(heard and heard.knows(sighting.stamp) for heard in pair)
            if not known and now - sighting.heard_at < TUNING.patience:
                self._waiting.append(sighting)
                continue
            own, peer = (heard and heard.pose_at(sighting.stamp) for heard in pair)
            if own and peer and same_time(own, peer) and sighting.peer != self._name:
                self._take(MapConstraint(self._name, sighting.peer, *from_sighting(
                    own, sighting.T_base_peer, sighting.covariance, peer), kind='sighting'))
            else:
                self._count('encounters_unusable', f'no pose of {self._name} or of '
                            f'{sighting.peer!r} at {sighting.stamp:.3f} s, or clocks that differ')
