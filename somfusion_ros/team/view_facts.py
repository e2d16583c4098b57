# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a robot tells of its own path: views and constraints, as whole numbers and back.

A view fact carries the step from a view before it, so that the views of a robot are one path;
other constraints of its own, its loops, are facts by themselves, and so are scans between two
views, which are only drawn: a map of views alone knows a sixth to a third less. Whoever solves,
also the robot itself, uses what the bytes say: the same facts then give the same map everywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import Array, compose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.team.beam_code import decode_beams, encode_beams
from somfusion_ros.team.compact import (covariance_from, covariance_numbers, from_steps, in_steps,
                                        STEP)
from somfusion_ros.team.fact import corners_in, Fact, LOOP, outline_of, SCAN, TAKEN_BACK, VIEW
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
TICKS = 1_000_000                    # [1/s] in which stamps are told
STEP_NUMBERS = 10                    # whole numbers of the step to a view
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class Facts:
    """
    What a robot tells of its path: views, constraints of loops, scans between.

    taken_back: views that show nothing any more, as those of a robot that was carried away.
    """

    views: tuple[Fact, ...] = ()
    loops: tuple[Fact, ...] = ()
    between: tuple[Fact, ...] = ()
    taken_back: tuple[Fact, ...] = ()

    @property
    def every(self) -> tuple[Fact, ...]:
        """All of them."""
        return self.views + self.loops + self.between + self.taken_back


@dataclass(frozen=True, eq=False)
class ViewFact:
    """
    A view: its number, stamp [s], the step to it, and what it saw.

    off (3,): how the pose T_map_view when it was told differs from the one that the step leads to.
    """

    number: int
    stamp: float
    off: Array
    step: Constraint | None
    beams: Sequence[int]
    outline: bytes

    def encode(self) -> Fact:
        """Return the fact."""
        step = ((self.number - self.step.first, *_measured(self.step)) if self.step
                else (0,) * STEP_NUMBERS)
        numbers = self.number, round(self.stamp * TICKS), *in_steps(self.off, STEP), *step
        return Fact(VIEW, (*numbers, *self.beams), self.outline)

    def pose_after(self, poses: Sequence[Array]) -> Array:
        """Return the pose (3,) when it was told, from those of the views before it."""
        if self.step is None:
            return self.off
        pose: Array = compose(poses[self.step.first], self.step.z) + self.off
        pose[2] = wrap(pose[2])
        return pose

    def told_at(self, pose: Array, poses: Sequence[Array]) -> 'ViewFact':
        """Return the view, told when it lay at a pose (3,), as bytes will say it."""
        step = self.step and replace(self.step, z=from_steps(in_steps(self.step.z, STEP), STEP))
        off = pose - replace(self, step=step, off=np.zeros(3)).pose_after(poses)
        off[2] = wrap(off[2])
        return replace(self, step=step, off=from_steps(in_steps(off, STEP), STEP))


def decode_view(fact: Fact) -> ViewFact:
    """Return what a fact tells of a view; ValueError, with one line, where it is absurd."""
    number, stamp, *rest = fact.numbers
    if not 0 <= number < MAX_VIEWS:
        raise ValueError(f'view {number} is not one of {MAX_VIEWS}')
    off, step = _placed(rest[:3]), None
    if number:
        back, *numbers = rest[3:3 + STEP_NUMBERS]
        if not 0 < back <= number:
            raise ValueError(f'view {number} does not follow a view before it')
        step = _constraint(number - back, number, numbers)
    return ViewFact(number, stamp / TICKS, off, step, rest[3 + STEP_NUMBERS:], fact.outline)


def _placed(numbers: Sequence[int]) -> Array:
    """Return a pose (3,); ValueError where it is nowhere."""
    pose = from_steps(numbers, STEP)
    if not np.abs(pose).max() < TUNING.farthest:
        raise ValueError('a view lies nowhere')
    return pose


def _measured(constraint: Constraint) -> list[int]:
    """Return the whole numbers of what a constraint measured, and how well."""
    R = constraint.R + np.diag([TUNING.least[0], TUNING.least[0], TUNING.least[1]]) ** 2 * ROUNDED
    R = R * min(1.0, 0.5 * TUNING.largest_variance / np.diag(R).max())
    return [*in_steps(constraint.z, STEP), *covariance_numbers(R)]


def encode_constraint(constraint: Constraint) -> Fact:
    """Return the fact of a constraint between two views of one robot."""
    return Fact(LOOP, (constraint.second, constraint.second - constraint.first,
                       *_measured(constraint)))


def decode_constraint(fact: Fact) -> Constraint:
    """
    Return a constraint; ValueError where it is absurd.

    Its covariance is positive definite: a claim to know better than the least is not believed.
    """
    second, back, *numbers = fact.numbers
    return _constraint(second - back, second, numbers)


def _constraint(first: int, second: int, numbers: Sequence[int]) -> Constraint:
    """Return a constraint between two views."""
    z, R = from_steps(numbers[:3], STEP), covariance_from(numbers[3:])
    if first == second or not 0 <= min(first, second) <= max(first, second) < MAX_VIEWS:
        raise ValueError(f'a constraint joins views {first} and {second}')
    if not np.abs(z).max() < TUNING.farthest:
        raise ValueError('a constraint leads nowhere')
    z[2] = wrap(z[2])
    return Constraint(first, second, z, believed(R[UPPER]))


def encode_scan(scan: DrawnScan) -> Fact:
    """Return the fact of a scan that is only drawn."""
    beams, corners = encode_beams(scan.outline)
    return Fact(SCAN, (scan.view, round(scan.stamp * TICKS), *in_steps(scan.T_view_base, STEP),
                       *beams), outline_of(corners))


def decode_scan(fact: Fact) -> DrawnScan:
    """Return a scan that is only drawn; ValueError where it is absurd."""
    view, stamp, *numbers = fact.numbers
    pose = _placed(numbers[:3])
    if not 0 <= view < MAX_VIEWS or np.abs(pose).max() >= TUNING.nearest:
        raise ValueError('a scan hangs on nothing')
    seen = decode_beams(numbers[3:], corners_in(fact.outline))
    return DrawnScan(stamp / TICKS, view, pose, seen.outline)


def encode_taken_back(views: range) -> Fact:
    """Return the fact that views show nothing any more."""
    return Fact(TAKEN_BACK, (views.start, len(views)))


def decode_taken_back(fact: Fact) -> range:
    """Return which views show nothing any more; ValueError where it is absurd."""
    first, count = fact.numbers
    if not 0 <= first < first + count <= MAX_VIEWS:
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
    chain, poses = [facts[k] for k in range(count)], list[Array]()
    for fact in chain:
        poses.append(fact.pose_after(poses))
    own = [decode_constraint(loop) for loop in told.loops]
    return ViewSet(
        np.array([fact.stamp for fact in chain]),
        np.array(poses).reshape(-1, 3),
        [decode_beams(fact.beams, corners_in(fact.outline)) for fact in chain],
        [fact.step for fact in chain if fact.step],
        [r for r in own if max(r.first, r.second) < count],
        [scan for scan in map(decode_scan, told.between) if scan.view < count])
