# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that lies, in every way that its seed chooses."""

from functools import cache
from hashlib import sha256
import json
from typing import Any

import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.simulation.chaos.network import Delivery, Network
from somfusion_ros.simulation.chaos.view_lies import absurd_batches, bonds_with, stolen
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond_message import BondMessage
from somfusion_ros.team.channels import BONDS, CHANGES, MAP, POSE, STATE, VIEWS
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.heard import TimedPose
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.map_codec import MapEncoder
from somfusion_ros.team.seal import Sealer
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.state_codec import decode_state, encode_state, TeamState

KINDS = ('garbage', 'wrong pairs', 'ghosts', 'absent robots', 'walls', 'free everywhere', 'replay',
         'flicker', 'poses', 'views', 'bonds')
GOOD = np.diag([1e-4, 1e-4, 1e-6])
PERIOD = 4.0      # [s] between two lies
EPOCH = Epoch('11a7', 0)


class Liar:
    """A liar of one kind; it hears the states of the others, and so knows their epochs."""

    def __init__(self, name: str, kind: str, network: Network, rng: np.random.Generator) -> None:
        self.name, self.kind = name, kind
        self._network, self._rng, self._number = network, rng, 0
        self._heard: dict[str, TeamState] = {}
        self._old: list[tuple[str, Any, int]] = []
        self._views: dict[str, list[bytes]] = {}
        self._sealer = Sealer(name, sha256(name.encode()).digest())
        self.due = 0.0     # [s]: when it says something next

    def meet(self, robot: str, now: float) -> None:
        """Listen to a robot."""
        for channel in (STATE, VIEWS) if self.kind == 'bonds' else (STATE,):
            self._network.subscribe(self.name, robot, channel, now)

    def hear(self, one: Delivery) -> None:
        """Remember what a robot says."""
        if one.channel == VIEWS:
            self._views.setdefault(one.sender, []).append(one.message.payload)
        elif one.channel == STATE:
            try:
                self._heard[one.sender] = decode_state(one.message.payload)
            except ValueError:
                return
            self._old.append((one.channel, one.message.payload, one.message.size))

    def work(self, now: float) -> None:
        """Say something, now and then."""
        if now < self.due:
            return
        self.due = now + PERIOD
        self._number += 1
        {'garbage': self._garbage, 'wrong pairs': self._wrong, 'ghosts': self._ghosts,
         'absent robots': self._absent, 'walls': self._walls, 'replay': self._replay,
         'free everywhere': self._free, 'flicker': self._flicker, 'poses': self._poses,
         'views': self._absurd_views, 'bonds': self._bonds}[self.kind](now)

    def _state(self, now: float, **parts: Any) -> None:
        """Say a state; every other one is sealed."""
        state = TeamState('11a7', epoch=EPOCH, number=self._number)._replace(**parts)
        if self._number % 2:
            state = state._replace(seal=self._sealer.seal(state.epoch, state.constraints))
        text = encode_state(state)
        self._network.publish(self.name, STATE, text, len(text), now)

    def _pose(self) -> Pose:
        """Make a pose up."""
        return Pose.from_array(self._rng.uniform((-15, -15, -3), (15, 15, 3)))

    def _about(self, robot: str, kind: str = 'match') -> MapConstraint:
        """Say where the own map lies in a robot's, wrongly and surely."""
        epoch = self._heard[robot].epoch or EPOCH
        return MapConstraint(self.name, robot, self._pose(), GOOD, 1.0, kind, (EPOCH, epoch))

    def _garbage(self, now: float) -> None:
        noise = self._rng.integers(0, 256, 60, dtype=np.uint8).tobytes()
        text = json.dumps({'version': 2, 'session': noise.hex(), 'constraints': [[[]]]})
        self._network.publish(self.name, STATE, str(self._rng.choice(
            [text, noise.hex(), '[' * 2000, '{"version": 1}'])), 100, now)
        self._network.publish(self.name, MAP, noise, len(noise), now)

    def _wrong(self, now: float) -> None:
        self._state(now, constraints=tuple(
            self._about(robot, kind) for robot in sorted(self._heard)
            for kind in ('match', 'sighting', 'sighting')))

    def _ghosts(self, now: float) -> None:
        self._state(now, constraints=tuple(
            MapConstraint(self.name, f'ghost{k}', self._pose(), GOOD, 1.0) for k in range(250)))

    def _absent(self, now: float) -> None:
        gone = [*(f'ghost{k}' for k in range(20)), *self._heard]
        self._state(now, departed=tuple(
            DepartedRobot(robot, 10 ** 9, tuple(MapConstraint(
                robot, other, self._pose(), GOOD, 1.0, 'match', (Epoch('9f'), EPOCH))
                for other in sorted(self._heard) if other != robot), Epoch('9f'))
            for robot in gone))

    def _walls(self, now: float) -> None:
        self._wrong(now)
        self._map(now, 900, 100)

    def _free(self, now: float) -> None:
        self._map(now, 300, -2)     # it has driven everywhere
        self._wrong(now)

    def _map(self, now: float, width: int, value: int) -> None:
        """Say a map of equal cells."""
        key = even_map(width, value)
        self._network.publish(self.name, MAP, key, len(key), now)

    def _replay(self, now: float) -> None:
        if self._old:
            channel, payload, size = self._old[int(self._rng.integers(len(self._old)))]
            self._network.publish(self.name, channel, payload, size, now)

    def _flicker(self, now: float) -> None:
        epoch = Epoch('11a7', self._number)
        self._state(now, epoch=epoch)
        self._network.publish(self.name, CHANGES, b'', 0, now)

    def _poses(self, now: float) -> None:
        self._state(now)
        for pose in (self._pose(), Pose(float('nan'), 0.0, 0.0), Pose(1e300, 0.0, 0.0)):
            self._network.publish(self.name, POSE, (TimedPose(now, pose, GOOD), EPOCH), 400, now)

    def _absurd_views(self, now: float) -> None:
        self._wrong(now)
        for batch in absurd_batches(EPOCH, self._rng):
            self._network.publish(self.name, VIEWS, batch, len(batch), now, log=True)

    def _bonds(self, now: float) -> None:
        """Take a robot's views for its own, and bend everybody."""
        self._wrong(now)
        for robot in sorted(self._views)[:1]:
            for batch in self._views[robot]:
                mine = stolen(batch, EPOCH)
                self._network.publish(self.name, VIEWS, mine, len(mine), now, log=True)
            self._views[robot] = []
        epochs = {robot: state.epoch or EPOCH for robot, state in self._heard.items()}
        data = BondMessage('11a7', self._number, bonds_with(
            self.name, EPOCH, epochs, self._rng, int(self._rng.integers(1, 3)))).encode()
        self._network.publish(self.name, BONDS, data, len(data), now)


@cache
def even_map(width: int, value: int) -> bytes:
    """Encode a square map, so many cells wide, of equal cells."""
    encoder = MapEncoder()
    encoder.encode(MapCells(np.full((width, width), value, np.int8), 0.05, Pose()), EPOCH)
    return encoder.key
