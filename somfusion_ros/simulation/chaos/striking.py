# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a fault does to a robot or to the network, and how it ends."""

from collections.abc import Sequence
from dataclasses import replace

from somfusion_ros.simulation.chaos.disk import restarted, VARIANTS
from somfusion_ros.simulation.chaos.faults import Fault
from somfusion_ros.simulation.chaos.network import Conditions
from somfusion_ros.simulation.chaos.records import Outcome
from somfusion_ros.simulation.chaos.robot import Robot
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch

CLOCK_STEPS = 20.0, 3600.0    # [s] of the smallest and the largest step of a clock, either way
DRIFT = 0.002                 # between the largest drifts: a thousandth


def worsened(fault: Fault, before: Conditions) -> Conditions:
    """Return how well the network works under a fault."""
    kind, size = fault.kind, fault.size
    if kind == 'loss':
        return replace(before, loss=0.2 + 0.5 * size)
    if kind == 'delay':
        return replace(before, delay=size, spread=2.0 * size)
    if kind == 'doubling':
        return replace(before, doubling=0.4, spread=3.0 * size)
    if kind == 'slow link':
        return replace(before, rate=1200.0)      # 9.6 kbit/s
    return replace(before, cut=frozenset({fault.robot}))


class Striking:
    """Lets faults of SLAM, clock and disk happen to robots; seed: part of the names of maps."""

    def __init__(self, tapes: Sequence[Tape], seed: int, outcome: Outcome) -> None:
        self._tapes, self._seed, self._outcome = tapes, seed, outcome

    def strike(self, fault: Fault, robot: Robot, now: float) -> None:
        """Let a fault happen to a robot at a time [s]."""
        kind, size = fault.kind, fault.size
        here = [tape for tape in self._tapes if tape.place == robot.tape.place]
        elsewhere = [tape for tape in self._tapes if tape.place != robot.tape.place]
        if kind == 'slam restart elsewhere':
            self.begin(robot, now, elsewhere[int(size * len(elsewhere))])
        elif kind in ('slam restart without state', 'reset'):
            self.begin(robot, now, here[int(size * len(here))])
        elif kind == 'carried off and found':
            self.begin(robot, now, max(self._tapes, key=lambda tape: tape.lost_for))
        elif kind == 'kidnapped':
            others = [tape for tape in self._tapes if tape is not robot.tape]
            robot.tape, robot.spoilt = others[int(size * len(others))], True
        elif kind == 'clock step':
            least, most = CLOCK_STEPS
            robot.clock.step += (1 if size > 0.5 else -1) * (
                least + abs(2.0 * size - 1.0) * (most - least))
        elif kind == 'clock drift':
            robot.clock.drift(1.0 + DRIFT * (size - 0.5), now)
        else:
            self._restart(robot, now, kind.removeprefix('disk '), int(VARIANTS * size))

    def begin(self, robot: Robot, now: float, tape: Tape) -> None:
        """Begin a map at the start of a tape."""
        robot.starts += 1
        robot.epoch = Epoch(f'{self._seed:x}{robot.name[-1]}x{robot.starts}')
        robot.telling, robot.moved = str(robot.epoch), robot.moved + 1
        robot.tape, robot.started, robot.spoilt = tape, now, False

    def _restart(self, robot: Robot, now: float, damage: str, variant: int) -> None:
        """Restart a robot's SLAM from what its disk kept, if it did."""
        come = robot.tape.come(now - robot.started)
        robot.starts += 1
        robot.telling = f'{robot.epoch}t{robot.starts}'
        damage = damage.removeprefix('slam restart with state')
        if not come:
            return self.begin(robot, now, robot.tape)
        if not damage and variant:
            return None     # it goes on where it was, and tells its path again
        tape, counts = restarted(robot.tape, come, damage, variant)
        robot.counts += counts
        if damage == 'flips bits' and not counts:
            self._outcome.broken.append(f'{robot.name}: a damaged disk, and nobody says so')
        if damage == 'is full' and not counts['state_not_saved']:
            self._outcome.broken.append(f'{robot.name}: a full disk, and nobody says so')
        if tape is None:
            return self.begin(robot, now, robot.tape)
        robot.epoch = robot.epoch.gone_back(str(robot.starts))
        robot.telling = f'{robot.epoch}t{robot.starts}'
        robot.tape, robot.started = tape, now
        return None
