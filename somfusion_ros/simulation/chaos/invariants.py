# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What must hold of a team whatever happens, and how to tell."""

from collections.abc import Mapping

import numpy as np
from somfusion_ros.geometry import between, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.records import Outcome, Robot
from somfusion_ros.simulation.chaos.station import Station, world_of
from somfusion_ros.simulation.chaos.tapes import Tape

EQUAL = 0.999        # share of the known cells in which all global maps must agree
SURE = 3.5           # sigmas, and
NEAR = 0.5           # [m] within which an accepted transform must be
HALF = 0.5           # of evidence; cells that differ by less say the same


class Invariants:
    """Checks a team, and writes down what is broken."""

    def __init__(self, robots: Mapping[str, Robot], outcome: Outcome) -> None:
        self._robots, self._outcome = robots, outcome

    def accepted(self, robot: Robot) -> None:
        """Check that what two honest robots accept now is true."""
        assert robot.station is not None
        for c in robot.station.session.snapshot.constraints:
            pair = [self._robots.get(name) for name in c.robots]
            if any(one is None or one.spoilt or one.epoch != epoch
                   for one, epoch in zip(pair, c.epochs)):
                continue
            target, source = (one for one in pair if one is not None)
            self._outcome.accepted += 1
            wrong = error_of(c.T_target_source, target.tape, source.tape)
            sigma = np.sqrt(np.trace(c.covariance[:2, :2]))
            if wrong > max(NEAR, SURE * sigma):
                self._outcome.broken.append(
                    f'{robot.name} accepted {c.target} - {c.source}, off by {wrong:.2f} m')

    def agreement(self) -> None:
        """Check that all that can talk hold the same global map."""
        stations = [robot.station for robot in self._robots.values()
                    if robot.station is not None and not robot.off]
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

    def _compare(self, members: list[Station]) -> None:
        """Check that poses and drawn maps of one group are the same."""
        first = world_of(members[0])
        drawn = [one.drawn for one in members if one.drawn is not None]
        if len(first) > 1 and len(drawn) == len(members):
            for grid in drawn[1:]:
                share = alike(drawn[0], grid)
                if share < EQUAL:
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
