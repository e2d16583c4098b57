# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of a simulated team, from one seed: bit for bit the same every time.

A run that breaks an invariant says which, and shrinks to the faults that are needed for it.
"""

from collections.abc import Callable, Sequence
from hashlib import blake2b

import numpy as np
from somfusion_ros.simulation.chaos.faults import choose, Fault, LAST
from somfusion_ros.simulation.chaos.invariants import Invariants
from somfusion_ros.simulation.chaos.liar import Liar
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.network import Conditions, Network
from somfusion_ros.simulation.chaos.records import Outcome, Robot
from somfusion_ros.simulation.chaos.station import Clock, Station, world_of
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch

TICK = 0.5           # [s] of simulated time between two steps
SETTLED = 30.0       # [s] after the last fault in which all must agree
LOOK = 2.0           # [s] between two looks at who is there


class Team:
    """A team at work in simulated time."""

    def __init__(self, seed: int, faults: Sequence[Fault] | None, tapes: Sequence[Tape],
                 matching: Matching) -> None:
        rng = np.random.default_rng(seed)
        self._tapes, self._matching = tapes, matching
        self.network = Network(np.random.default_rng([seed, 1]))
        self._rng = np.random.default_rng([seed, 2])
        names = [f'robot{k + 1}' for k in range(int(rng.integers(2, 4)))]
        here = [tape for tape in tapes if tape.place == tapes[0].place]
        self.robots = {name: Robot(name, here[k % len(here)], Clock(
            float(rng.uniform(0.999, 1.001)), float(rng.uniform(0, 1e5))))
            for k, name in enumerate(names)}
        self.faults = choose(names, rng) if faults is None else list(faults)
        self.liars: dict[str, Liar] = {}
        self.outcome = Outcome(seed, self.faults)
        self._invariants = Invariants(self.robots, self.outcome)
        self._seed = seed
        for robot in self.robots.values():
            self._begin(robot, 0.0)
            self._start(robot)

    def run(self) -> Outcome:
        """Run to the end, and check all along."""
        todo = [(fault.at, k, True) for k, fault in enumerate(self.faults)] + [
            (min(fault.at + fault.lasts, LAST), k, False) for k, fault in enumerate(self.faults)]
        todo.sort()
        now, looked = 0.0, -LOOK
        while now < LAST + SETTLED and not self.outcome.broken:
            now += TICK
            while todo and todo[0][0] <= now:
                _, k, begins = todo.pop(0)
                self._strike(self.faults[k], now) if begins else self._mend(self.faults[k], now)
            if now - looked >= LOOK:
                looked = now
                self._look(now)
            self._step(now)
        self.outcome.seconds, self.outcome.digest = now, self._digest()
        if not self.outcome.broken:
            self._invariants.agreement()
        return self.outcome

    def _digest(self) -> bytes:
        """Return bytes that only a run of the same words, poses and maps has."""
        found = blake2b(digest_size=16)
        for robot in self.robots.values():
            if robot.station is not None:
                found.update(repr((robot.station.words, sorted(world_of(robot.station).items()),
                                   sorted(robot.station.counts.items()))).encode())
                if robot.station.drawn is not None:
                    found.update(robot.station.drawn.evidence.tobytes())
        return found.digest()

    def _step(self, now: float) -> None:
        """Let everybody do a step of work."""
        try:
            for one in self.network.deliver(now):
                if one.listener in self.liars:
                    self.liars[one.listener].hear(one)
                else:
                    station = self.robots[one.listener].station
                    if station is not None:
                        station.hear(one)
            for liar in self.liars.values():
                liar.work(now)
            for robot in self.robots.values():
                if robot.station is not None and not robot.off:
                    robot.station.map_of(robot.tape, robot.epoch, now - robot.started)
                    robot.station.work(now)
                    self._invariants.accepted(robot)
        except Exception as error:  # noqa: B902 (whatever is raised is a find)
            self.outcome.broken.append(f'{now:.1f} s: raised {error!r}')

    def _look(self, now: float) -> None:
        """Let everybody look who is there."""
        there = [robot for robot in self.robots.values() if robot.station and not robot.off]
        for robot in there:
            assert robot.station is not None
            robot.station.present = {
                other for other in (*(r.name for r in there), *self.liars)
                if other != robot.name and self.network.reaches(robot.name, other)}
            for other in sorted(robot.station.present):
                robot.station.meet(other)
        for liar in self.liars.values():
            for robot in there:
                liar.meet(robot.name, now)

    def _begin(self, robot: Robot, now: float) -> None:
        """Begin a map at the start of the robot's tape."""
        robot.starts += 1
        robot.epoch = Epoch(f'{self._seed:x}{robot.name[-1]}x{robot.starts}')
        robot.started, robot.spoilt = now, False

    def _start(self, robot: Robot) -> None:
        """Start a fusion node."""
        robot.starts += 1
        robot.station = Station(robot.name, f'{self._seed:x}{robot.name[-1]}n{robot.starts}',
                                self.network, self._matching, robot.clock)

    def _strike(self, fault: Fault, now: float) -> None:
        """Let a fault happen."""
        robot, conditions = self.robots[fault.robot], self.network.conditions
        kind, _, lie = fault.kind.partition(': ')
        if kind == 'liar':
            name = f'{"az"[int(fault.size > 0.5)]}liar{len(self.liars)}'
            self.liars[name] = Liar(name, lie, self.network, self._rng)
        elif kind == 'loss':
            conditions.loss = 0.2 + 0.5 * fault.size
        elif kind == 'delay':
            conditions.delay, conditions.spread = fault.size, 2.0 * fault.size
        elif kind == 'doubling':
            conditions.doubling, conditions.spread = 0.4, 3.0 * fault.size
        elif kind == 'slow link':
            conditions.rate = 1200.0
        elif kind == 'cut':
            conditions.cut = frozenset({robot.name})
        elif kind in ('fusion crash', 'robot off'):
            self._stop(robot, kind == 'robot off')
        elif kind == 'slam restart elsewhere':
            others = [tape for tape in self._tapes if tape.place != robot.tape.place]
            robot.tape = others[int(fault.size * len(others))]
            self._begin(robot, now)
        elif kind in ('slam restart without state', 'reset'):
            here = [tape for tape in self._tapes if tape.place == robot.tape.place]
            robot.tape = here[int(fault.size * len(here))]
            self._begin(robot, now)
        elif kind == 'kidnapped':
            others = [tape for tape in self._tapes if tape is not robot.tape]
            robot.tape, robot.spoilt = others[int(fault.size * len(others))], True
        elif kind == 'clock step':
            robot.clock.step += 7200.0 * (fault.size - 0.5)

    def _mend(self, fault: Fault, now: float) -> None:
        """Let a fault end."""
        robot = self.robots[fault.robot]
        if fault.kind in ('loss', 'delay', 'doubling', 'slow link', 'cut'):
            self.network.conditions = Conditions()
        elif fault.kind in ('fusion crash', 'robot off') and robot.station is None:
            robot.off = False
            self._start(robot)
        elif fault.kind == 'kidnapped' and robot.spoilt:
            self._begin(robot, now)     # somebody noticed, and reset its map
        elif fault.kind.startswith('liar') and self.liars:
            name = sorted(self.liars)[0]
            self.network.leave(name)
            del self.liars[name]

    def _stop(self, robot: Robot, off: bool) -> None:
        """Stop a fusion node, or the whole robot."""
        robot.off, robot.station = off, None
        self.network.leave(robot.name)


def run_seed(seed: int, tapes: Sequence[Tape], matching: Matching,
             faults: Sequence[Fault] | None = None) -> Outcome:
    """Run one seed, or its team under other faults."""
    return Team(seed, faults, tapes, matching).run()


def shrink(outcome: Outcome, tapes: Sequence[Tape], matching: Matching,
           on_try: Callable[[], object] = lambda: None) -> Outcome:
    """Leave faults out one by one while an invariant still breaks."""
    k = 0
    while k < len(outcome.faults):
        on_try()
        fewer = outcome.faults[:k] + outcome.faults[k + 1:]
        tried = run_seed(outcome.seed, tapes, matching, fewer)
        if tried.broken:
            outcome = tried
        else:
            k += 1
    return outcome
