# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of a simulated team, from one seed: bit for bit the same every time.

A run that breaks an invariant says which, and shrinks to the faults that are needed for it.
"""

from collections.abc import Callable, Sequence
from hashlib import blake2b

import numpy as np
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.simulation.chaos.faults import choose, EPISODE, EPISODES, Fault, NETWORK
from somfusion_ros.simulation.chaos.invariants import Invariants
from somfusion_ros.simulation.chaos.liar import Liar
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.network import Network
from somfusion_ros.simulation.chaos.records import Clock, Outcome
from somfusion_ros.simulation.chaos.robot import Robot
from somfusion_ros.simulation.chaos.station import Station, world_of
from somfusion_ros.simulation.chaos.striking import Striking, worsened
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.team.config import TeamConfig

TICK = 0.5           # [s] of simulated time between two steps
SETTLED = 30.0       # [s] after the last new map of an episode, in which all must agree
LOOK = 2.0           # [s] between two looks at who is there
DRAWN = 16           # of so many teams one really draws its views, which takes long
ABROAD = 0.1         # share of the teams that begin elsewhere
KNOWING = 0.15       # share of the teams whose start poses are given,
SEEING = 0.5         # and of those whose robots see one another,
SIGHT = 4.0          # [m] within which they do, and with
SIGMAS = np.array([0.05, 0.05, 0.02])    # [m, m, rad]


class Team:
    """A team at work in simulated time."""

    def __init__(self, seed: int, faults: Sequence[Fault] | None, tapes: Sequence[Tape],
                 matching: Matching) -> None:
        rng = np.random.default_rng(seed)
        self._matching, self._seed = matching, seed
        matching.draws = seed % DRAWN == 0
        self.network = Network(np.random.default_rng([seed, 1]))
        self._rng = np.random.default_rng([seed, 2])
        names = [f'robot{k + 1}' for k in range(int(rng.integers(2, 4)))]
        home = tapes[0].place
        abroad = sorted({tape.place for tape in tapes} - {home})
        place = abroad[0] if rng.random() < ABROAD and abroad else home
        here = [tape for tape in tapes if tape.place == place]
        self.robots = {name: Robot(name, here[k % len(here)], Clock(
            float(rng.uniform(0.99998, 1.00002)), float(rng.uniform(0, 1e5))))
            for k, name in enumerate(names)}
        self.faults = choose(names, rng) if faults is None else list(faults)
        self.liars: dict[str, Liar] = {}
        self.outcome = Outcome(seed, self.faults)
        self._invariants = Invariants(self.robots, self.outcome)
        self._striking = Striking(tapes, seed, self.outcome)
        self._sees = self._rng.random() < SEEING
        self._given = self._poses_given() if self._rng.random() < KNOWING else TeamConfig()
        for robot in self.robots.values():
            self._striking.begin(robot, 0.0, robot.tape)
        for robot in self.robots.values():
            self._start(robot)

    def _poses_given(self) -> TeamConfig:
        """Return the configuration of a team whose start poses are known."""
        return TeamConfig(known_init_poses=True, initial_poses=tuple(
            ' '.join([robot.name, *(f'{number:.3f}' for number in robot.tape.T_place_map)])
            for robot in self.robots.values()))

    def run(self) -> Outcome:
        """Run to the end, and check all along."""
        todo = [(fault.at, k, True) for k, fault in enumerate(self.faults)] + [
            (fault.at + fault.lasts, k, False) for k, fault in enumerate(self.faults)]
        todo.sort()
        now, looked, ends = 0.0, -LOOK, [EPISODE * k for k in range(1, EPISODES + 1)]
        while ends and not self.outcome.broken:
            now = self._next(now, min(looked + LOOK, ends[0], todo[0][0] if todo else np.inf))
            while todo and todo[0][0] <= now:
                _, k, begins = todo.pop(0)
                self._strike(self.faults[k], now) if begins else self._mend(self.faults[k], now)
            if now - looked >= LOOK:
                looked = now
                self._look(now)
            self._step(now)
            if now >= ends[0]:
                self._agree(ends.pop(0))
        self.outcome.seconds, self.outcome.digest = now, self._digest()
        if not self.outcome.broken:
            self._invariants.said()
        return self.outcome

    def _next(self, now: float, due: float) -> float:
        """Return the next tick [s] at which anything happens; due [s]: the latest time."""
        if all(robot.tape.over(now - robot.started) for robot in self.robots.values()):
            due = min(due, self.network.next_at, *(liar.due for liar in self.liars.values()),
                      *(robot.station.due for robot in self.robots.values() if robot.station))
            return max(now + TICK, TICK * float(np.ceil(due / TICK)))
        return now + TICK

    def _agree(self, now: float) -> None:
        """Check that all agree at the end of an episode, once the last drive is long over."""
        if not self.outcome.broken and now >= SETTLED + max(
                robot.started + robot.tape.map_times[-1] for robot in self.robots.values()):
            self._invariants.agreement()

    def _digest(self) -> bytes:
        """Return bytes that only a run of the same words, poses and maps has."""
        found = blake2b(digest_size=16)
        for robot in self.robots.values():
            if robot.station is not None:
                found.update(repr((robot.station.words, sorted(world_of(robot.station).items()),
                                   sorted(robot.station.counts.items()))).encode())
                robot.station.draw()
                if robot.station.drawn is not None:
                    found.update(robot.station.drawn.evidence.tobytes())
        return found.digest()

    def _step(self, now: float) -> None:
        """Let everybody do a step of work."""
        try:
            for robot in self.robots.values():
                if robot.station is not None and not robot.off:
                    robot.station.follow(robot.playing(now), now)
            for one in self.network.deliver(now):
                if one.listener in self.liars:
                    self.liars[one.listener].hear(one)
                    continue
                station = self.robots[one.listener].station
                if station is not None:
                    station.hear(one)
                    if one.sender not in self.liars:
                        self._invariants.reports.heard(station, one, now)
                    else:
                        self._invariants.reports.lied(station, self.liars[one.sender].kind, one)
            for liar in self.liars.values():
                liar.work(now)
            for robot in self.robots.values():
                if robot.station is not None and not robot.off:
                    before = self._matching.asked
                    if not robot.station.work(now):
                        continue
                    pieces = self._matching.asked - before
                    self._invariants.worked(robot, pieces, self._matching.sizes)
                    self._invariants.accepted(robot, now)
        except Exception as error:  # noqa: B902 (whatever is raised is a find)
            self.outcome.broken.append(f'{now:.1f} s: raised {error!r}')

    def _look(self, now: float) -> None:
        """Let everybody look who is there."""
        there = [robot for robot in self.robots.values() if robot.station and not robot.off]
        for robot in there:
            assert robot.station is not None
            robot.station.look({
                other for other in (*(r.name for r in there), *self.liars)
                if other != robot.name and self.network.reaches(robot.name, other)})
            for other in sorted(robot.station.present):
                robot.station.meet(other)
            self._invariants.look(robot)
        for liar in self.liars.values():
            for robot in there:
                liar.meet(robot.name, now)
        if self._sees:
            self._see(there, now)

    def _see(self, there: Sequence[Robot], now: float) -> None:
        """Let robots that are near one another see each other, now and then."""
        for robot in there:
            for other in there:
                if robot is other or robot.spoilt or other.spoilt or (
                        robot.tape.place != other.tape.place):
                    continue
                own, peer = (compose(one.tape.T_place_map, one.tape.pose_at(now - one.started))
                             for one in (robot, other))
                seen = between(own, peer)
                if np.hypot(seen[0], seen[1]) < SIGHT and self._rng.random() < 0.5:
                    noisy = seen + SIGMAS * self._rng.normal(size=3)
                    assert robot.station is not None
                    robot.station.see(other.name, Pose.from_array(noisy), np.diag(SIGMAS ** 2),
                                      now)

    def _start(self, robot: Robot) -> None:
        """Start a fusion node; start poses are given as long as they are right."""
        robot.starts += 1
        given = self._given if all(one.moved == 0 for one in self.robots.values()) else (
            TeamConfig())
        robot.station = Station(robot.name, f'{self._seed:x}{robot.name[-1]}n{robot.starts}',
                                self.network, self._matching, robot.clock, given)

    def _strike(self, fault: Fault, now: float) -> None:
        """Let a fault happen."""
        robot = self.robots[fault.robot]
        kind, _, lie = fault.kind.partition(': ')
        if kind == 'liar':
            name = self._liar_of(fault)
            self.liars[name] = Liar(name, lie, self.network, self._rng)
        elif kind in NETWORK:
            self.network.conditions = worsened(fault, self.network.conditions)
        elif kind in ('fusion crash', 'robot off'):
            self._stop(robot, kind == 'robot off')
        else:
            self._striking.strike(fault, robot, now)

    def _mend(self, fault: Fault, now: float) -> None:
        """Let a fault end."""
        robot = self.robots[fault.robot]
        if fault.kind in NETWORK:
            self.network.recover(now)
        elif fault.kind in ('fusion crash', 'robot off') and robot.station is None:
            robot.off = False
            self._start(robot)
        elif fault.kind == 'kidnapped' and robot.spoilt:
            self._striking.begin(robot, now, robot.tape)     # somebody noticed, and reset its map
        elif fault.kind.startswith('liar'):
            self.network.leave(self._liar_of(fault))
            del self.liars[self._liar_of(fault)]

    def _liar_of(self, fault: Fault) -> str:
        """Return the name of a liar, which sorts before those of all robots, or after them."""
        return f'{"az"[int(fault.size > 0.5)]}liar{self.faults.index(fault)}'

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
