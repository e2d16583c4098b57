# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot of a simulated team: what its SLAM does, and its fusion node if that runs."""

from collections import Counter
from dataclasses import dataclass, field

from somfusion_ros.simulation.chaos.records import Clock, Playing
from somfusion_ros.simulation.chaos.station import Station
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch


@dataclass
class Robot:
    """
    One robot.

    started [s]: when its tape began; starts: of its programs; moved: how many maps it began after
    its first; spoilt: its map is wrong, for it was kidnapped and nobody noticed; counts: what its
    SLAM counted.
    """

    name: str
    tape: Tape
    clock: Clock
    started: float = 0.0
    epoch: Epoch = Epoch('', 0)
    telling: str = ''
    station: Station | None = None
    off: bool = False
    spoilt: bool = False
    moved: int = -1
    starts: int = 0
    counts: Counter[str] = field(default_factory=Counter)

    def playing(self, now: float) -> Playing:
        """Return what its SLAM does at a time [s]."""
        return Playing(self.tape, self.epoch, self.telling, now - self.started)
