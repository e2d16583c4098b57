# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong in a simulated team, and when: a list that one seed chooses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from somfusion_ros.simulation.chaos.disk import KINDS as DAMAGE
from somfusion_ros.simulation.chaos.liar import KINDS as LIES

NETWORK = ('loss', 'delay', 'doubling', 'slow link', 'cut')
ROBOT = ('fusion crash', 'robot off', 'slam restart elsewhere', 'slam restart with state',
         'slam restart without state', 'reset', 'kidnapped', 'carried off and found', 'clock step',
         'clock drift')
DISK = tuple(f'disk {kind}' for kind in DAMAGE if kind)
KINDS = (*NETWORK, *ROBOT, *DISK, *(f'liar: {kind}' for kind in LIES))
EPISODES = 2     # in a run: faults, then peace in which all must come to agree
EPISODE = 180.0  # [s] from the start of one to the start of the next,
FIRST = 8.0      # [s] of its first fault, and
LAST = 70.0      # [s] at which its last one is mended


class Fault(NamedTuple):
    """A fault of a kind that begins at a time [s], lasts [s], and strikes a robot."""

    at: float
    kind: str
    robot: str
    lasts: float
    size: float

    def __str__(self) -> str:
        """Say it in one line."""
        return f'{self.at:5.1f} s: {self.kind}, {self.robot}, for {self.lasts:.1f} s'


def choose(robots: Sequence[str], rng: np.random.Generator) -> list[Fault]:
    """Choose faults for a team, in the order of time."""
    faults = []
    for episode in range(EPISODES):
        for _ in range(int(rng.integers(2, 7))):
            at = float(rng.uniform(FIRST, LAST - 5.0))
            faults.append(Fault(EPISODE * episode + at, str(rng.choice(KINDS)),
                                str(rng.choice(list(robots))),
                                float(rng.uniform(2.0, LAST - at)), float(rng.uniform())))
    return sorted(faults)
