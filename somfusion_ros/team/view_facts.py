# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a robot tells of its own path: views and constraints, as bytes and back.

A view fact carries the step from a view before it, so that the views of a robot are one path;
other constraints of its own, its loops, are facts by themselves, and so are scans between two
views, which are only drawn: a map of views alone knows a sixth to a third less. Whoever solves,
also the robot itself, uses what the bytes say: the same facts then give the same map everywhere.
"""

from collections import Counter
from dataclasses import dataclass
import struct
from weakref import WeakSet

import numpy as np
from somfusion_ros.geometry import Array, compose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import Place, place_of
from somfusion_ros.team.beam_code import decode_beams, encode_beams
from somfusion_ros.team.compact import (pack, pack_covariance, pack_scaled, STEP, unpack,
                                        unpack_covariance, unpack_scaled)
from somfusion_ros.team.view_set import DrawnScan, ViewSet


@dataclass(frozen=True)
class FactLimits:
    """What is told of a path, and what is believed of what came."""

    spacing: float = tuned(0.2, 'm, rad', 'between scans that are told to be drawn: at 0.1 they '
                           'cost twice as much, without any the map knows up to a third less',
                           'mines, wean, Intel and CSAIL')
    per_place: int = tuned(2, 'scans', 'between views that are told of one place: whoever comes '
                           'again and again tells views only', 'Intel, wean')
    farthest: float = tuned(1e5, 'm', 'from the origin of a map', 'by design')
    nearest: float = tuned(100.0, 'm', 'from its view that a scan may lie', 'by design')
    least: tuple[float, float] = tuned((1e-3, 5e-4), 'm, rad', 'sigma that is believed of a '
                                       'constraint at least; as of any match', 'by design')
    largest_variance: float = tuned(1e8, 'm^2', 'of a constraint that says anything',
                                    'by design')


TUNING = FactLimits()
ROUNDED = 1 / 100                    # of the least variance: keeps one above 0 that is told
MAX_VIEWS = 100_000                  # of one robot in one epoch
STAMP = struct.Struct('<d')
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class Facts:
    """What a robot tells of its path, packed: views, constraints of loops, scans between."""

    views: tuple[bytes, ...] = ()
    loops: tuple[bytes, ...] = ()
    between: tuple[bytes, ...] = ()

    @property
    def size(self) -> int:
        """Bytes in all."""
        return sum(len(fact) for kind in (self.views, self.loops, self.between) for fact in kind)


@dataclass(frozen=True, eq=False)
class ViewFact:
    """A view: its number, stamp [s], pose T_map_view (3,) when told, beams, the step to it."""

    number: int
    stamp: float
    pose: Array
    beams: bytes
    step: Constraint | None

    def encode(self) -> bytes:
        """Pack the fact."""
        head = pack((self.number,)) + STAMP.pack(self.stamp) + pack_scaled(self.pose, STEP)
        step = encode_constraint(self.step, self.number) if self.step else b''
        return head + step + self.beams


def decode_view(data: bytes) -> ViewFact:
    """Unpack a view; ValueError, with one line, where it is damaged or absurd."""
    (number,), rest = unpack(data, 1)
    stamp, pose, rest = _placed(rest)
    if not 0 <= number < MAX_VIEWS:
        raise ValueError(f'view {number} is not one of {MAX_VIEWS}')
    step = None
    if number:
        step, rest = _constraint(rest, number)
        if step.first >= number:
            raise ValueError(f'view {number} does not follow a view before it')
    return ViewFact(number, stamp, pose, rest, step)


def _placed(data: bytes) -> tuple[float, Array, bytes]:
    """Unpack a stamp and a pose (3,); return them and what follows."""
    if len(data) < STAMP.size:
        raise ValueError('a view is cut short')
    stamp, = STAMP.unpack_from(data)
    pose, rest = unpack_scaled(data[STAMP.size:], STEP)
    if not (np.isfinite(stamp) and np.abs(pose).max() < TUNING.farthest):
        raise ValueError('a view lies nowhere')
    return stamp, pose, rest


def encode_constraint(constraint: Constraint, second: int = 0) -> bytes:
    """Pack a constraint between two views of one robot, some 20 bytes; second may be known."""
    R = constraint.R + np.diag([TUNING.least[0], TUNING.least[0], TUNING.least[1]]) ** 2 * ROUNDED
    R = R * min(1.0, 0.5 * TUNING.largest_variance / np.diag(R).max())
    views = () if second else (constraint.second,)
    return (pack((*views, constraint.second - constraint.first))
            + pack_scaled(constraint.z, STEP) + pack_covariance(R))


def decode_constraint(data: bytes) -> Constraint:
    """
    Unpack a constraint; ValueError where it is damaged or absurd.

    Its covariance is positive definite: a claim to know better than the least is not believed.
    """
    (second,), rest = unpack(data, 1)
    constraint, rest = _constraint(rest, second)
    if rest:
        raise ValueError('a constraint is too long')
    return constraint


def _constraint(data: bytes, second: int) -> tuple[Constraint, bytes]:
    """Unpack a constraint that leads to a view; return it and what follows."""
    (back,), rest = unpack(data, 1)
    z, rest = unpack_scaled(rest, STEP)
    R, rest = unpack_covariance(rest)
    first = second - back
    if first == second or not 0 <= min(first, second) <= max(first, second) < MAX_VIEWS:
        raise ValueError(f'a constraint joins views {first} and {second}')
    if not np.abs(z).max() < TUNING.farthest:
        raise ValueError('a constraint leads nowhere')
    z[2] = wrap(z[2])
    return Constraint(first, second, z, believed(R[UPPER])), rest


def encode_scan(scan: DrawnScan) -> bytes:
    """Pack a scan that is only drawn."""
    return (pack((scan.view,)) + STAMP.pack(scan.stamp) + pack_scaled(scan.T_view_base, STEP)
            + encode_beams(scan.outline))


def decode_scan(data: bytes) -> DrawnScan:
    """Unpack a scan that is only drawn; ValueError where it is damaged or absurd."""
    (view,), rest = unpack(data, 1)
    stamp, pose, rest = _placed(rest)
    if not 0 <= view < MAX_VIEWS or np.abs(pose).max() >= TUNING.nearest:
        raise ValueError('a scan hangs on nothing')
    return DrawnScan(stamp, view, pose, decode_beams(rest).outline)


def believed(upper: Array) -> Array:
    """Return a covariance (3, 3), floored, of its triangle (6,); ValueError if absurd."""
    R = np.zeros((3, 3))
    R[UPPER] = upper
    R = R + R.T - np.diag(np.diag(R))
    if not 0.0 < np.diag(R).min() <= np.diag(R).max() < TUNING.largest_variance:
        raise ValueError('a covariance is absurd')
    scale = np.sqrt(np.diag(R))
    values, vectors = np.linalg.eigh(R / np.outer(scale, scale))
    if values[0] < -1e-3:
        raise ValueError('a covariance is not positive')
    R = ((vectors * np.maximum(values, 1e-6)) @ vectors.T) * np.outer(scale, scale)
    floor = np.array([TUNING.least[0], TUNING.least[0], TUNING.least[1]]) ** 2
    raised: Array = R + np.diag(np.maximum(floor - np.diag(R), 0.0))
    return raised


class Teller:
    """Tells of a robot's path what it has not told yet."""

    def __init__(self) -> None:
        self._views = self._constraints = self._steps = self._rows = 0
        self._told: WeakSet[Outline] = WeakSet()
        self._last: tuple[int, Array] = -1, np.zeros(3)
        self._places: Counter[Place] = Counter()

    def more(self, path: Checkpoint) -> Facts:
        """Return the facts of a path that are new."""
        steps, loops = {}, []
        for constraint in path.constraints[self._constraints:]:
            if constraint.second == self._steps + 1:     # the first that leads to a view
                self._steps += 1
                steps[constraint.second] = constraint
            else:
                loops.append(encode_constraint(constraint))
        views = []
        for k in range(self._views, len(path.clouds)):
            outline = path.clouds[k].outline
            self._told.add(outline)
            views.append(ViewFact(k, float(path.stamps[k]), path.poses[k], encode_beams(outline),
                                  steps.get(k)).encode())
        between = [encode_scan(scan) for scan in self._fresh(path)]
        self._views, self._constraints = len(path.clouds), len(path.constraints)
        return Facts(tuple(views), tuple(loops), tuple(between))

    def _fresh(self, path: Checkpoint) -> list[DrawnScan]:
        """Choose scans that are new, spaced from one another and from the view they hang on."""
        rows = path.trail[min(self._rows, len(path.trail)):]
        stamps = {(int(row[1]), *row[2:]): float(row[0]) for row in rows}
        self._rows = len(path.trail)
        chosen = []
        for scan in path.scans:
            if scan.outline in self._told:
                continue
            self._told.add(scan.outline)
            view, last = self._last
            x, y, theta = scan.T_view_base - (last if view == scan.view else np.zeros(3))
            stamp = stamps.get((scan.view, *scan.T_view_base))
            if stamp is None or max(np.hypot(x, y), abs(wrap(theta))) < TUNING.spacing:
                continue
            self._last = scan.view, scan.T_view_base
            place = place_of(compose(path.poses[scan.view], scan.T_view_base))
            self._places[place] += 1
            if self._places[place] <= TUNING.per_place:
                chosen.append(DrawnScan(stamp, scan.view, scan.T_view_base, scan.outline))
        return chosen


def tell(path: Checkpoint) -> Facts:
    """Tell of a robot's path all at once."""
    return Teller().more(path)


def heard(told: Facts) -> ViewSet:
    """
    Put a robot's facts together; ValueError where they do not fit.

    Views after the first that is missing, and constraints of such views, wait.
    """
    facts = {fact.number: fact for fact in map(decode_view, told.views)}
    count = next((k for k in range(len(facts)) if k not in facts), len(facts))
    chain = [facts[k] for k in range(count)]
    own = [decode_constraint(loop) for loop in told.loops]
    return ViewSet(
        np.array([fact.stamp for fact in chain]),
        np.array([fact.pose for fact in chain]).reshape(-1, 3),
        [decode_beams(fact.beams) for fact in chain],
        [fact.step for fact in chain if fact.step],
        [r for r in own if max(r.first, r.second) < count],
        [scan for scan in map(decode_scan, told.between) if scan.view < count])
