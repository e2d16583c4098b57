# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a robot tells its peers, and when: each thing once, and again where it changed.

A state is repeated now and then, so that silence means absence. The map is told only while
somebody listens, as a key and what changed since.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, difference
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, MAP
from somfusion_ros.team.heard import TimedPose
from somfusion_ros.team.map_codec import MapEncoder
from somfusion_ros.team.seal import Sealer
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.state_codec import encode_state, fitting, TeamState


@dataclass(frozen=True)
class OutboxTuning:
    """How often things are told."""

    heartbeat: float = tuned(
        10.0, 's', 'a state is repeated after this time though nothing changed', 'by design')
    refined: float = tuned(
        3.0, 's', 'between two states that differ in how well pairs are known, and not in which '
        'there are; a pose that holds moves by 0.15 m at most', 'network wire 8')
    stood_still: float = tuned(
        0.02, 'm, rad', 'a pose that moved less is not told again', 'not measured')


TUNING = OutboxTuning()


class Outbox:
    """
    Decides what is worth telling now; what carries it is up to the caller.

    session: in which the robot of that name speaks; secret (32 bytes): with which it seals.
    """

    def __init__(self, session: str, name: str, secret: bytes) -> None:
        self.session, self._sealer = session, Sealer(name, secret)
        self._number = 0
        self._epoch = Epoch()
        self._encoder = MapEncoder()
        self._cells: MapCells | None = None
        self._sent: dict[str, bytes | None] = {MAP: None, CHANGES: None}
        self._said: tuple[str, Any, float] = '', None, 0.0
        self._told: Array | None = None     # the pose (3,) that was told last

    def state(self, snapshot: Snapshot, since: int, now: float) -> str | None:
        """
        Return the state to send; None where it was said already, and not long ago.

        since [ns] is the stamp from which on the robot's clusters are of its present map. Where
        robots were is told with the rest, and is no reason to tell it.
        """
        state = fitting(TeamState(self.session, snapshot.constraints, snapshot.departed,
                                  snapshot.epoch, since, self._number,
                                  refuted=snapshot.refuted, given=snapshot.given,
                                  denied=snapshot.denied))
        said, pairs, at = self._said
        same, there = encode_state(state) == said, _pairs_of(state)
        if now - at < (TUNING.heartbeat if same else TUNING.refined if there == pairs else 0.0):
            return None
        self._number += 1
        state = state._replace(number=self._number)
        self._said = encode_state(state), there, now
        return encode_state(state._replace(
            seal=self._sealer.seal(state.epoch, state.constraints),
            whereabouts=snapshot.whereabouts))

    def moved(self, here: TimedPose) -> bool:
        """Note the robot's pose; return whether it moved since it was told last."""
        pose = np.array(here.pose)
        if self._told is not None and (
                np.abs(difference(pose, self._told)).max() < TUNING.stood_still):
            return False
        self._told = pose
        return True

    def share(self, cells: MapCells, epoch: Epoch) -> None:
        """Keep the robot's newest map, for those who want it."""
        self._cells, self._epoch = cells, epoch

    def map_messages(self) -> list[tuple[str, bytes]]:
        """Return, by channel, what those who listen to the map have not got yet."""
        if self._cells is not None:
            self._encoder.encode(self._cells, self._epoch)
            self._cells = None
        fresh = []
        for channel, data in ((MAP, self._encoder.key or None), (CHANGES, self._encoder.change)):
            if data is not None and data is not self._sent[channel]:
                self._sent[channel] = data
                fresh.append((channel, data))
        return fresh


def _pairs_of(state: TeamState) -> Any:
    """Return what a state says, but for numbers: what others must know at once."""
    return (state.epoch, state.given, state.denied, state.refuted,
            [(one.robots, one.kind, one.epochs) for one in state.constraints],
            [(gone.robot, gone.epoch, gone.seal) for gone in state.departed])
