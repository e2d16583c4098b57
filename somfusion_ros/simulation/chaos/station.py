# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One robot of a simulated team: what fusion_node does around the session, without ROS.

The session, the inbox, the outbox and all codecs are the real ones; the SLAM's part is a tape of
what a real one made.
"""

from collections import Counter
from hashlib import sha256
import re
from typing import Any

import numpy as np
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.network import Delivery, Network
from somfusion_ros.simulation.chaos.records import Clock, Playing
from somfusion_ros.simulation.chaos.views import ViewEnd
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import (BONDS, CHANGES, CLUSTERS, MAP, PLAIN_MAP, POSE, STATE,
                                         VIEWS)
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.inbox import Inbox, TimedClusters
from somfusion_ros.team.lent_map import lent_map
from somfusion_ros.team.map_codec import key_message, number_of
from somfusion_ros.team.outbox import Outbox
from somfusion_ros.team.plain_epochs import PlainMap
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.sightings import Sighting, Sightings

MAX_CELLS = 10 ** 6
DEPARTED, DEPARTED_VIEWS = 'departed', 'departed views'
DRAW_EVERY = 2.0     # [s] between two looks at whether the global map is to be drawn anew
WORK_EVERY = 1.0     # [s] between two pieces of work where nothing came; twice as long, up to
REST = 8.0           # [s], as long as nothing changes
NUMBER = re.compile(r'"number": \d+')    # of a state
POSE_COVARIANCE = np.diag([4e-4, 4e-4, 1e-4])


class Station:
    """One robot's fusion node, from its start to its end."""

    def __init__(self, name: str, session: str, network: Network, matching: Matching,
                 clock: Clock, config: TeamConfig = TeamConfig()) -> None:
        self.name, self.clock, self.config = name, clock, config
        self.words: list[str] = []
        self.counts: Counter[str] = Counter()
        self.drawn: Grid | None = None
        self.present: set[str] = set()
        self._network, self._matching, self._now = network, matching, 0.0
        self.session = FusionSession(name, config, FusionConfig(), self.words.append,
                                     self._steady, matching, self._count)
        self.inbox = Inbox(name, self.session, MAX_CELLS, self._count, self._steady,
                           lambda: 1e-9 * clock.stamp(self._now))
        self.inbox.heard[name] = Heard()
        self.views = ViewEnd(name, session, self.session, self.inbox.heard, network,
                             self._count, self._steady)
        self.sightings = Sightings(name, self.inbox.heard, self.session.take_sighting,
                                   self._count)
        self._outbox = Outbox(session, name, sha256(session.encode()).digest())
        self._since = 0
        self._epoch: Epoch | None = None
        self._departed: dict[str, Any] = {}
        self._cells: MapCells | None = None
        self._draw_due = self.due = 0.0     # due [s]: when there is work, unless something comes
        self._rest = WORK_EVERY
        self._before: Any = None    # what was shown when it was drawn last, and
        self._stirred = False       # whether anything else was done since
        self._states: dict[str, str] = {}

    def follow(self, slam: Playing, now: float) -> None:
        """Hear the robot's own SLAM: which map it is, the newest map, and the pose in it."""
        self._now = now
        epoch, come = slam.epoch, slam.tape.come(slam.elapsed)
        loaded = (epoch.reset, len(epoch.start))
        self.inbox.plain.tell(self.name, epoch, loaded)
        cells = slam.tape.maps[come - 1] if come else None
        if cells is not None and (cells is not self._cells or epoch != self._epoch):
            self._cells = cells
            self._wake()
            self.inbox.keep(self.name, PLAIN_MAP, PlainMap(cells, loaded), cells.values.size, same)
        pose = TimedPose(1e-9 * self.clock.stamp(now), slam.tape.pose_at(slam.elapsed),
                         POSE_COVARIANCE)
        self.inbox.keep_pose(self.name, lambda: (pose, None))
        self.views.tell(slam, now)

    def see(self, peer: str, T_base_peer: Pose, covariance: Array, now: float) -> None:
        """Take a sighting of a peer, made now."""
        self.sightings.add(Sighting(peer, 1e-9 * self.clock.stamp(now), T_base_peer, covariance,
                                    self.clock.steady(now)))

    def meet(self, robot: str) -> None:
        """Listen to a robot that is there."""
        if robot not in self.inbox.heard:
            self.inbox.heard[robot] = Heard()
        for channel in (STATE, CLUSTERS, POSE):
            self._network.subscribe(self.name, robot, channel, self._now)

    def hear(self, one: Delivery) -> None:
        """Take what came over the network."""
        robot, payload = one.sender, one.message.payload
        if one.channel != POSE and not self._repeated(one):
            self._wake()
        if one.channel in (VIEWS, BONDS):
            self.views.hear(one)
        elif one.channel.startswith(f'{DEPARTED_VIEWS}/'):
            self.views.hear_kept(one.channel.partition('/')[2], payload)
        elif one.channel.startswith(f'{DEPARTED}/'):
            robot = one.channel.partition('/')[2]
            self.inbox.heard.setdefault(robot, Heard())
            self.inbox.keep(robot, MAP, payload, one.message.size, lent_map)
        elif robot in self.inbox.heard and one.channel == POSE:
            self.inbox.keep_pose(robot, lambda: payload)
        elif robot in self.inbox.heard:
            rank = number_of(payload) if one.channel in (MAP, CHANGES) else 0
            read = self._matching.read_state if one.channel == STATE else same
            self.inbox.keep(robot, one.channel, payload, one.message.size, read, rank)

    def work(self, now: float) -> bool:
        """Do what the worker of a fusion node does, if there may be anything; return whether."""
        if now < self.due:
            return False
        self._now, words = now, len(self.words)
        self.views.drain()
        own, network = self.inbox.drain(), self._network
        epoch = self.session.epoch_of(self.name)
        if own is not None and epoch is not None:
            if epoch != self._epoch:
                self._epoch, self._since = epoch, self.clock.stamp(now)
            self._outbox.share(own, epoch)
            clusters = self._matching.clusters(self.session)
            network.publish(self.name, CLUSTERS, TimedClusters(clusters, self.clock.stamp(now)),
                            28 * len(clusters), now)
        self.sightings.settle(self._steady())
        snapshot = self.session.refresh(self.present)
        self._since = min(self._since, self.clock.stamp(now))
        text = self._outbox.state(snapshot, self._since, self._steady())
        if text is not None:
            network.publish(self.name, STATE, text, len(text), now)
        for peer in sorted(snapshot.wanted & self.present):
            for channel in (MAP, CHANGES):
                network.subscribe(self.name, peer, channel, now)
        self.views.want(snapshot.wanted & self.present, now)
        self.views.say(now)
        if network.listened(self.name, MAP):
            for channel, data in self._outbox.map_messages():
                network.publish(self.name, channel, data, len(data), now)
        moved = self._tell_pose(now)
        self._hand_on(now)
        matched = self.session.attempt(self._steady())
        self._stirred |= moved or matched is not None or len(self.words) > words
        if now >= self._draw_due:
            self._draw_due = now + DRAW_EVERY
            self.draw()
            shown = snapshot.solution, dict(snapshot.placed), self.drawn
            idle = shown == self._before and not self._stirred
            self._rest, self._before = min(2.0 * self._rest, REST) if idle else WORK_EVERY, shown
            self._stirred = False
        self.due = now + self._rest
        return True

    def look(self, present: set[str]) -> None:
        """Note who is there."""
        if present != self.present:
            self.present = present
            self._wake()

    def _wake(self) -> None:
        """Work at once: something came."""
        self.due, self._rest = 0.0, WORK_EVERY

    def _repeated(self, one: Delivery) -> bool:
        """Return whether a message is a state that only says once more what it said before."""
        if one.channel != STATE:
            return False
        said = NUMBER.sub('', one.message.payload)
        before, self._states[one.sender] = self._states.get(one.sender), said
        return said == before

    def draw(self) -> None:
        """Draw the global map, where it changed."""
        drawn = self.session.draw()
        self.drawn = self.drawn if drawn is None else drawn

    def held(self) -> Counter[str]:
        """Count what this robot holds of its team: what grows if a peer can make it grow."""
        session = self.session
        solution, maps = session.snapshot.solution, session.shown_maps().values()
        return Counter({
            'bytes of views': sum(map(session.elastic.bytes_of, self.inbox.heard)),
            'robots': sum(map(len, solution.groups)), 'dropped': len(solution.dropped),
            'departed': len(session.snapshot.departed), 'counted': len(self.counts),
            'cells': sum(shared.grid.evidence.size for shared in maps),
            'cells drawn': 0 if self.drawn is None else self.drawn.evidence.size})

    def _tell_pose(self, now: float) -> bool:
        """Tell where the robot is; return whether it moved."""
        poses = self.inbox.heard[self.name].poses
        if not (poses and self._epoch is not None and self._outbox.moved(poses[-1])):
            return False
        self._network.publish(self.name, POSE, (poses[-1], self._epoch), 400, now)
        return True

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
            self._hand_views_on(gone.robot, now)
        for robot, keeper in sorted(snapshot.sources.items()):
            for channel in (DEPARTED, DEPARTED_VIEWS):
                network.subscribe(self.name, keeper, f'{channel}/{robot}', now)

    def _hand_views_on(self, robot: str, now: float) -> None:
        """Offer what a robot that is gone told of its path, where somebody asks."""
        channel, kept = f'{DEPARTED_VIEWS}/{robot}', b''
        if self._network.listened(self.name, channel):
            kept = self.session.elastic.kept(robot)
        if kept and kept != self._departed.get(channel):
            self._departed[channel] = kept
            self._network.publish(self.name, channel, kept, len(kept), now)

    def _steady(self) -> float:
        """Return the time [s] of the clock that is never stepped."""
        return self.clock.steady(self._now)

    def _count(self, kind: str, reason: str = '') -> None:
        self.counts[kind] += 1


def same(content: Any) -> Any:
    """Return a message as it is: a simulation writes none."""
    return content


def world_of(station: Station) -> dict[str, Pose]:
    """T_world_map by robot, as a station places them."""
    return station.session.snapshot.solution.group_of(station.name)
