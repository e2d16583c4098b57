# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a robot tells of its own path: views and constraints, as bytes and back.

A view fact carries the step from a view before it, so that the views of a robot are one path;
other constraints of its own, its loops, are facts by themselves, and so are scans between two
views, which are only drawn: a map of views alone knows a sixth to a third less. Whoever solves,
also the robot itself, uses what the bytes say: the same facts then give the same map everywhere.
"""

from dataclasses import dataclass
import struct

import numpy as np
from somfusion_ros.geometry import Array, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.team.beam_code import decode_beams, encode_beams
from somfusion_ros.team.compact import (pack, pack_covariance, pack_scaled, STEP, unpack,
                                        unpack_covariance, unpack_scaled)
from somfusion_ros.team.view_set import DrawnScan, ViewSet


@dataclass(frozen=True)
class FactLimits:
    """What is believed of what came."""

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
    """
    What a robot tells of its path, packed: views, constraints of loops, scans between.

    taken_back: views that show nothing any more, as those of a robot that was carried away.
    """

    views: tuple[bytes, ...] = ()
    loops: tuple[bytes, ...] = ()
    between: tuple[bytes, ...] = ()
    taken_back: tuple[bytes, ...] = ()

    @property
    def size(self) -> int:
        """Bytes in all."""
        return sum(len(fact) for kind in (self.views, self.loops, self.between, self.taken_back)
                   for fact in kind)


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


def decode_taken_back(fact: bytes) -> range:
    """Unpack which views show nothing any more; ValueError where it is absurd."""
    (first, count), rest = unpack(fact, 2)
    if rest or not 0 <= first < first + count <= MAX_VIEWS:
        raise ValueError('views that do not exist are taken back')
    return range(first, first + count)


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
