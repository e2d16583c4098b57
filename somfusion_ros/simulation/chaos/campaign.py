# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of a simulated team, from one seed: bit for bit the same every time.

A run that breaks an invariant says which, and shrinks to the faults that are needed for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
from somfusion_ros.geometry import between, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.faults import choose, Fault, LAST
from somfusion_ros.simulation.chaos.liar import Liar
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.network import Conditions, Network
from somfusion_ros.simulation.chaos.station import Clock, Station, world_of
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch

TICK = 0.5           # [s] of simulated time between two steps
SETTLED = 30.0       # [s] after the last fault in which all must agree
EQUAL = 0.999        # share of the known cells in which all global maps must agree
SURE = 3.5           # sigmas, and
NEAR = 0.5           # [m] within which an accepted transform must be
HALF = 0.5           # of evidence; cells that differ by less say the same
LOOK = 2.0           # [s] between two looks at who is there


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
            self._check_agreement()
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
                    self._check_accepted(robot)
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

    def _check_accepted(self, robot: Robot) -> None:
        """Check that what two honest robots accept now is true."""
        assert robot.station is not None
        for c in robot.station.session.snapshot.constraints:
            pair = [self.robots.get(name) for name in c.robots]
            if any(one is None or one.spoilt or one.epoch != epoch
                   for one, epoch in zip(pair, c.epochs)):
                continue
            target, source = (one for one in pair if one is not None)
            self.outcome.accepted += 1
            wrong = error_of(c.T_target_source, target.tape, source.tape)
            sigma = np.sqrt(np.trace(c.covariance[:2, :2]))
            if wrong > max(NEAR, SURE * sigma):
                self.outcome.broken.append(
                    f'{robot.name} accepted {c.target} - {c.source}, off by {wrong:.2f} m')

    def _check_agreement(self) -> None:
        """Check that all that can talk hold the same global map."""
        stations = [robot.station for robot in self.robots.values()
                    if robot.station is not None and not robot.off]
        groups: dict[frozenset[str], list[Station]] = {}
        for station in stations:
            world = frozenset(world_of(station).keys() & self.robots.keys())
            groups.setdefault(world, []).append(station)
            if station.name not in world:
                self.outcome.broken.append(f'{station.name} is not in its own world')
        for world, members in groups.items():
            there = {name for name in world if self.robots[name].station is not None}
            if {one.name for one in members} != there:
                self.outcome.broken.append(
                    f'{[one.name for one in members]} say that they are {sorted(world)}')
            self.outcome.joined |= len(world) > 1
            self._compare(members)

    def _compare(self, members: list[Station]) -> None:
        """Check that poses and drawn maps of one group are the same."""
        first = world_of(members[0])
        drawn = [one.drawn for one in members if one.drawn is not None]
        if len(first) > 1 and len(drawn) == len(members):
            for grid in drawn[1:]:
                share = alike(drawn[0], grid)
                if share < EQUAL:
                    self.outcome.broken.append(f'global maps of {[one.name for one in members]} '
                                               f'agree in {share:.4f} only')
        for other in members[1:]:
            for name, pose in world_of(other).items():
                off = np.subtract(first.get(name, pose), pose)
                if name in self.robots and (np.hypot(off[0], off[1]) > 0.05
                                            or abs(wrap(off[2])) > 0.01):
                    self.outcome.broken.append(
                        f'{members[0].name} and {other.name} place {name} '
                        f'{np.hypot(off[0], off[1]):.2f} m apart')


def error_of(T_target_source: Pose, target: Tape, source: Tape) -> float:
    """How far off [m] a transform of two tapes' maps is; inf between two buildings."""
    if target.place != source.place:
        return float('inf')
    truth = between(target.T_place_map, source.T_place_map)
    return float(np.hypot(*(between(truth, T_target_source)[:2])))


def alike(one: Grid, other: Grid) -> float:
    """Share of the cells known to either map in which both say the same, within a cell."""
    points = one.points(one.known)
    cells = other.point_to_cell(points)
    inside = ((cells >= 0) & (cells < other.shape)).all(1)
    same = np.zeros(len(points), bool)
    theirs = other.evidence[tuple(cells[inside].T)]
    same[inside] = np.abs(theirs - one.evidence[one.known][inside]) < HALF
    return float(same.sum() / max(len(points), np.count_nonzero(other.known)))


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
