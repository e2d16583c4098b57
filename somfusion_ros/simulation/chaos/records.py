# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulated team is made of, and what a run of it finds."""

from dataclasses import dataclass, field

from somfusion_ros.simulation.chaos.faults import Fault
from somfusion_ros.simulation.chaos.station import Clock, Station
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch


@dataclass
class Robot:
    """One robot: what it drives, since when, under which epoch, and its fusion node if it runs."""

    name: str
    tape: Tape
    clock: Clock
    started: float = 0.0
    epoch: Epoch = Epoch('', 0)
    station: Station | None = None
    off: bool = False
    spoilt: bool = False     # its map is wrong: it was kidnapped
    starts: int = 0


@dataclass
class Outcome:
    """What a run found: broken invariants; accepted transforms, and how many lie too far off."""

    seed: int
    faults: list[Fault]
    broken: list[str] = field(default_factory=list)
    seconds: float = 0.0
    accepted: int = 0
    joined: bool = False
    digest: bytes = b''
