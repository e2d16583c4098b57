# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What must hold of a team whatever happens, and how to tell."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import between, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.records import Outcome
from somfusion_ros.simulation.chaos.reports import Reports
from somfusion_ros.simulation.chaos.robot import Robot
from somfusion_ros.simulation.chaos.station import Station, world_of
from somfusion_ros.simulation.chaos.tapes import Tape
from somfusion_ros.slam.epoch import Epoch

EQUAL = 0.999        # share of the known cells in which all global maps must agree,
SPOILT = 0.99        # and where a map in them is a liar's, lies where another's start pose has it,
#                      or is of a place that looks alike: what it calls driven, and so free,
#                      counts only for those whose own match accepted it, and nobody frees its
#                      own walls
SURE = 3.5           # sigmas, and
NEAR = 0.5           # [m] within which an accepted transform must be
BENT = 1.0           # [m] within which views must leave it,
PATIENCE = 15.0      # [s] after which they must: what is shown moves in steps
TOLD = 45.0          # [s] after which two ends that looked alike must not be taken for one: the
#                      next maps and four refusals have yet to come
HALF = 0.5           # of evidence; cells that differ by less say the same
# Matches, solutions and drawings of a station in one step, and how large the largest may be.
MOST_AT_ONCE = {'work': 8, 'constraints solved': 5 * 256, 'cells matched': 10 ** 6,
                'scans drawn': 5000}
# What a station may hold at most of a team of three and two liars.
MOST = {'bytes of views': 2 * 10 ** 6, 'robots': 80, 'dropped': 5 * 256, 'departed': 64,
        'counted': 64, 'cells': 5 * 10 ** 6, 'cells drawn': 4 * 10 ** 6}


class Invariants:
    """Checks a team, and writes down what is broken."""

    def __init__(self, robots: Mapping[str, Robot], outcome: Outcome) -> None:
        self._robots, self._outcome = robots, outcome
        self._verdicts: dict[tuple[Station, str], Alignment] = {}
        self._epochs: dict[tuple[Station, str], Epoch] = {}
        self._wrong_since: dict[tuple[Station, str, str], float] = {}
        self.reports = Reports()

    def accepted(self, robot: Robot, now: float) -> None:
        """Check that what two honest robots accept now is true, also as the views bend it."""
        station = robot.station
        assert station is not None
        snapshot = station.session.snapshot
        left_out = {d.constraint.robots for d in snapshot.solution.dropped}
        for c in snapshot.constraints:
            pair = self._good(c.robots, c.epochs)
            if pair is None:
                continue
            self._outcome.accepted += 1
            wrong = error_of(c.T_target_source, *pair)
            sigma = np.sqrt(np.trace(c.covariance[:2, :2]))
            if wrong > max(NEAR, SURE * sigma) and not self._excused(c.robots, now):
                self._broken(f'{robot.name} accepted {c.target} - {c.source}, off by '
                             f'{wrong:.2f} m ({c.kind})')
            elif c.kind == 'match' and wrong < BENT and c.robots not in left_out:
                self._bent(station, c.robots, pair, now)
        for peer, verdict in snapshot.verdicts.items():
            if self._verdicts.get((station, peer)) is not verdict:
                self._verdicts[station, peer] = verdict
                self._judge(station, peer, verdict)

    def _told(self, names: Sequence[str]) -> float | None:
        """Return when [s] the maps of two ends that look alike tell them apart; None of others."""
        pair = [self._robots[name] for name in names]
        if pair[0].tape.T_place_map == pair[1].tape.T_place_map or not any(
                one.tape.alike_until for one in pair):
            return None
        return max(one.started + one.tape.alike_until for one in pair)

    def _excused(self, names: Sequence[str], now: float) -> bool:
        """Return whether two ends were alike until a while ago; note how long they are told."""
        told = self._told(names)
        if told is None:
            return False
        self._outcome.stood = max(self._outcome.stood, now - told)
        return now - told < TOLD

    def _bent(self, station: Station, names: tuple[str, str], pair: tuple[Tape, Tape],
              now: float) -> None:
        """Check that two maps are shown where they are, within some time, as views bend them."""
        key, placed = (station, *names), station.session.snapshot.placed
        if not {*names} <= {*station.session.elastic.solved}:
            self._wrong_since.pop(key, None)
            return
        self._outcome.bent += 1
        off = error_of(Pose.from_array(between(*(placed[name] for name in names))), *pair)
        if off <= BENT:
            self._wrong_since.pop(key, None)
        elif now - self._wrong_since.setdefault(key, now) > PATIENCE:
            self._broken(f'{station.name} shows {" - ".join(names)}, off by {off:.2f} m, as views '
                         'bend it')

    def _good(self, names: Sequence[str], epochs: Sequence[Epoch | None]
              ) -> tuple[Tape, Tape] | None:
        """Return the tapes of two honest robots whose maps are good and of these epochs."""
        pair = [self._robots.get(name) for name in names]
        good = [one.tape for one, epoch in zip(pair, epochs)
                if one is not None and not one.spoilt and one.epoch == epoch]
        return (good[0], good[1]) if len(good) == 2 else None

    def _judge(self, station: Station, peer: str, verdict: Alignment) -> None:
        """Note how probable a pose was called, and whether it was right."""
        names = sorted((station.name, peer))
        pair = self._good(names, [station.session.epoch_of(name) for name in names])
        if pair is not None and verdict.T_target_source is not None:
            right = error_of(verdict.T_target_source, *pair) < NEAR
            judged = self._outcome.judged if self._told(names) is None else self._outcome.alike
            judged.append((verdict.probability, right))

    def look(self, robot: Robot) -> None:
        """Check that a station said which maps began anew, and that what it holds is bounded."""
        station = robot.station
        assert station is not None
        session = station.session
        for name in sorted({robot.name, *station.inbox.heard}):
            epoch, before = session.epoch_of(name), self._epochs.pop((station, name), None)
            if epoch is None or name not in {robot.name, *station.present}:
                continue    # who was away, and forgotten, is new when it comes back
            self._epochs[station, name] = epoch
            if before not in (None, epoch) and not any(
                    word.startswith((f'{name} began another map', f'{name} went back'))
                    and f'({epoch})' in word for word in station.words):
                self._broken(f'{robot.name} does not say that {name} began {epoch}')
        held = station.held()
        for what, most in MOST.items():
            if held[what] > most:
                self._broken(f'{robot.name} holds {held[what]} {what}')
            self._outcome.counts[what] = max(self._outcome.counts[what], held[what])

    def worked(self, robot: Robot, pieces: int, sizes: Counter[str]) -> None:
        """Check that a step has few pieces of heavy work, and none is too large."""
        for what, size in (('work', pieces), *sizes.items()):
            self._outcome.counts[what] = max(self._outcome.counts[what], size)
            if size > MOST_AT_ONCE[what]:
                self._broken(f'{robot.name} had {size} {what} at once')
        sizes.clear()

    def said(self) -> None:
        """Check that every station counted what it was to count."""
        for robot in self._robots.values():
            if robot.station is not None:
                for name in self.reports.missing(robot.station):
                    self._broken(f'{robot.name} did not count {name}')

    def _broken(self, text: str) -> None:
        """Write down what is broken."""
        self._outcome.broken.append(text)

    def agreement(self) -> None:
        """
        Check that all that can talk hold the same global map.

        Who was restarted without the start poses that the others were given need not.
        """
        stations = [robot.station for robot in self._robots.values()
                    if robot.station is not None and not robot.off]
        if len({one.config for one in stations}) > 1:
            return
        self._outcome.agreed += 1
        groups: dict[frozenset[str], list[Station]] = {}
        for station in stations:
            world = frozenset(world_of(station).keys() & self._robots.keys())
            groups.setdefault(world, []).append(station)
            if station.name not in world:
                self._outcome.broken.append(f'{station.name} is not in its own world')
        for world, members in groups.items():
            there = {name for name in world if self._robots[name].station is not None}
            if {one.name for one in members} != there:
                self._outcome.broken.append(
                    f'{[one.name for one in members]} say that they are {sorted(world)}')
            self._outcome.joined |= len(world) > 1
            self._compare(members)

    def _all_true(self, station: Station, world: Mapping[str, Pose]) -> bool:
        """Return whether no map in a world is a liar's, of another end, or misplaced by a user."""
        return (world.keys() <= self._robots.keys()
                and not any(self._robots[name].tape.alike_until for name in world)
                and not (station.config.known_init_poses
                         and any(self._robots[name].moved for name in world)))

    def _compare(self, members: list[Station]) -> None:
        """Check that poses and drawn maps of one group are the same."""
        first = world_of(members[0])
        drawn = [one.drawn for one in members if one.drawn is not None]
        bent = {frozenset(one.session.elastic.solved) for one in members}   # else other pictures
        if len(first) > 1 and len(drawn) == len(members) and len(bent) == 1:
            least = EQUAL if self._all_true(members[0], first) else SPOILT
            for grid in drawn[1:]:
                share = alike(drawn[0], grid)
                if share < least:
                    self._outcome.broken.append(
                        f'global maps of {[one.name for one in members]} agree in {share:.4f}')
        for other in members[1:]:
            for name, pose in world_of(other).items():
                off = np.subtract(first.get(name, pose), pose)
                apart = np.hypot(off[0], off[1]) > 0.05 or abs(wrap(off[2])) > 0.01
                if name in self._robots and apart:
                    self._outcome.broken.append(
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
