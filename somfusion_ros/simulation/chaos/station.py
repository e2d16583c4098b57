# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One robot of a simulated team: what fusion_node does around the session, without ROS.

The session, the inbox, the outbox and all codecs are the real ones; the SLAM's part is a tape of
what a real one made.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.network import Delivery, Network
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, CLUSTERS, MAP, PLAIN_MAP, POSE, STATE
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.inbox import Inbox, TimedClusters
from somfusion_ros.team.map_codec import key_message, number_of
from somfusion_ros.team.outbox import Outbox
from somfusion_ros.team.plain_epochs import PlainMap
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells

MAX_CELLS = 10 ** 6
DEPARTED = 'departed'
DRAW_EVERY = 2.0     # [s] between two looks at whether the global map is to be drawn anew
POSE_COVARIANCE = np.diag([4e-4, 4e-4, 1e-4])


@dataclass
class Clock:
    """A robot's clock: it drifts, and its stamps may be stepped; the steady one is not."""

    rate: float = 1.0
    offset: float = 0.0
    step: float = 0.0

    def steady(self, now: float) -> float:
        """Return the steady time [s] at a true time [s]."""
        return self.offset + self.rate * now

    def stamp(self, now: float) -> int:
        """Return the stamp [ns] at a true time [s]."""
        return round(1e9 * (1e6 + self.rate * now + self.step))


class Station:
    """One robot's fusion node, from its start to its end."""

    def __init__(self, name: str, session: str, network: Network, matching: Matching,
                 clock: Clock) -> None:
        self.name, self.clock = name, clock
        self.words: list[str] = []
        self.counts: Counter[str] = Counter()
        self.drawn: Grid | None = None
        self.present: set[str] = set()
        self._network, self._matching, self._now = network, matching, 0.0
        self.session = FusionSession(name, TeamConfig(), FusionConfig(), self.words.append,
                                     lambda: self.clock.steady(self._now), matching)
        self.inbox = Inbox(name, self.session, MAX_CELLS, self._count,
                           lambda: self.clock.steady(self._now))
        self.inbox.heard[name] = Heard()
        self._outbox = Outbox(session)
        self._since = 0
        self._epoch: Epoch | None = None
        self._departed: dict[str, Any] = {}
        self._cells: MapCells | None = None
        self._draw_due = 0.0

    def map_of(self, tape: Tape, epoch: Epoch, elapsed: float) -> None:
        """Hear the robot's own SLAM: which map it is, the newest map, and the pose in it."""
        loaded = (epoch.reset, len(epoch.start))
        self.inbox.plain.tell(self.name, epoch, loaded)
        cells = tape.map_at(elapsed)
        if cells is not None and (cells is not self._cells or epoch != self._epoch):
            self._cells = cells
            self.inbox.keep(self.name, PLAIN_MAP, PlainMap(cells, loaded), cells.values.size, same)
        pose = TimedPose(1e-9 * self.clock.stamp(self._now), tape.pose_at(elapsed),
                         POSE_COVARIANCE)
        self.inbox.keep_pose(self.name, lambda: (pose, None))

    def meet(self, robot: str) -> None:
        """Listen to a robot that is there."""
        if robot not in self.inbox.heard:
            self.inbox.heard[robot] = Heard()
        for channel in (STATE, CLUSTERS, POSE):
            self._network.subscribe(self.name, robot, channel, self._now)

    def hear(self, one: Delivery) -> None:
        """Take what came over the network."""
        robot, payload = one.sender, one.message.payload
        if one.channel.startswith(DEPARTED):
            robot = one.channel.partition('/')[2]
            self.inbox.heard.setdefault(robot, Heard())
            self.inbox.keep(robot, MAP, payload, one.message.size, same)
        elif robot in self.inbox.heard and one.channel == POSE:
            self.inbox.keep_pose(robot, lambda: payload)
        elif robot in self.inbox.heard:
            rank = number_of(payload) if one.channel in (MAP, CHANGES) else 0
            self.inbox.keep(robot, one.channel, payload, one.message.size, same, rank)

    def work(self, now: float) -> None:
        """Do what the worker of a fusion node does, once."""
        self._now = now
        own, network = self.inbox.drain(), self._network
        epoch = self.session.epoch_of(self.name)
        if own is not None and epoch is not None:
            if epoch != self._epoch:
                self._epoch, self._since = epoch, self.clock.stamp(now)
            self._outbox.share(own, epoch)
            clusters = self._matching.clusters(self.session)
            network.publish(self.name, CLUSTERS, TimedClusters(clusters, self.clock.stamp(now)),
                            28 * len(clusters), now)
        snapshot = self.session.refresh(self.present)
        self._since = min(self._since, self.clock.stamp(now))
        text = self._outbox.state(snapshot, self._since, self.clock.steady(now))
        if text is not None:
            network.publish(self.name, STATE, text, len(text), now)
        for peer in sorted(snapshot.wanted & self.present):
            for channel in (MAP, CHANGES):
                network.subscribe(self.name, peer, channel, now)
        if network.listened(self.name, MAP):
            for channel, data in self._outbox.map_messages():
                network.publish(self.name, channel, data, len(data), now)
        self._tell_pose(now)
        self._hand_on(now)
        self.session.attempt(self.clock.steady(now))
        if now >= self._draw_due:
            self._draw_due = now + DRAW_EVERY
            drawn = self.session.draw()
            self.drawn = self.drawn if drawn is None else drawn

    def _tell_pose(self, now: float) -> None:
        """Tell where the robot is, if it moved."""
        poses = self.inbox.heard[self.name].poses
        if poses and self._epoch is not None and self._outbox.moved(poses[-1]):
            self._network.publish(self.name, POSE, (poses[-1], self._epoch), 400, now)

    def _hand_on(self, now: float) -> None:
        """Offer and fetch the maps of robots that are gone."""
        snapshot, network = self.session.snapshot, self._network
        for gone in snapshot.departed:
            shared = snapshot.departed_maps[gone.robot]
            channel = f'{DEPARTED}/{gone.robot}'
            if network.listened(self.name, channel) and (
                    self._departed.get(gone.robot) is not shared):
                self._departed[gone.robot] = shared
                key = key_message(shared.to_cells(), gone.epoch)
                network.publish(self.name, channel, key, len(key), now)
        for robot, keeper in sorted(snapshot.sources.items()):
            network.subscribe(self.name, keeper, f'{DEPARTED}/{robot}', now)

    def _count(self, kind: str, reason: str = '') -> None:
        self.counts[kind] += 1


def same(content: Any) -> Any:
    """Return a message as it is: a simulation writes none."""
    return content


def world_of(station: Station) -> dict[str, Pose]:
    """T_world_map by robot, as a station places them."""
    return station.session.snapshot.solution.group_of(station.name)
