# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulated team is made of, and what a run of it finds."""

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

from somfusion_ros.simulation.chaos.faults import Fault
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch


class Playing(NamedTuple):
    """What a robot's SLAM does: a tape for a time [s], a map's epoch, a telling of its path."""

    tape: Tape
    epoch: Epoch
    telling: str
    elapsed: float


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

    def drift(self, rate: float, now: float) -> None:
        """Run at another rate from a true time [s] on."""
        self.offset += (self.rate - rate) * now
        self.step += (self.rate - rate) * now
        self.rate = rate


@dataclass
class Outcome:
    """
    What a run found: broken invariants, and what was checked.

    seconds: of simulated time; accepted: transforms, bent: those as views bend them; agreed:
    times that all were to agree; joined: whether maps were joined at one of these; digest: bytes
    that only the same run has; judged: verdicts on two maps that are good, each with its
    probability and whether its pose was right; alike: those on two ends that look alike; stood
    [s]: how long such ends were taken for one after maps could tell them; counts: the most that
    a station held or did at once.
    """

    seed: int
    faults: list[Fault]
    broken: list[str] = field(default_factory=list)
    seconds: float = 0.0
    accepted: int = 0
    bent: int = 0
    agreed: int = 0
    joined: bool = False
    digest: bytes = b''
    judged: list[tuple[float, bool]] = field(default_factory=list)
    alike: list[tuple[float, bool]] = field(default_factory=list)
    stood: float = 0.0
    counts: Counter[str] = field(default_factory=Counter)
