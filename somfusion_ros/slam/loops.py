# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop closure: which old places to try, and which matches to believe.

A candidate is an old view whose surface should lie near the new view's, by the filter's own
uncertainty. A loop must pass the chi-square gate on its innovation, unless the filter is sure:
it may be surer than it should be. Then, and where it is unsure, other loops found near must agree
before any of them is trusted.

Where places look alike, loops that are all shifted to the next one agree as well. So while the
uncertainty is large, a loop counts only if it fits nowhere else that the robot may be, and those
that agree must span as much travel as the robot may be off: if it has not yet come to the place,
the right loop would show itself by then.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import (apply, Array, between, compose, inverse, squared_mahalanobis,
                                    wrap)
from somfusion_ros.settings import tuned
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class LoopTuning:
    """Which old places are tried, and when a loop is believed (doc/slam.md)."""

    candidates: int = tuned(
        2, 'passes', 'old ones that a new view is matched against', 'shared logs')
    span: int = tuned(
        20, 'views', 'back to which every view is tied, loop or not', 'shared logs')
    farthest: float = tuned(
        4.0, 'm', 'beyond the search distance, however uncertain the filter is', 'not measured')
    sure: tuple[float, float] = tuned(
        (0.25, 0.06), 'm, rad',
        'sigma up to which a match that passes the gate is believed at once',
        'benchmarks/slam/look_alikes.py')
    partners: int = tuned(
        2, 'loops', 'must agree with one found from afar', 'benchmarks/slam/look_alikes.py')
    partners_near: int = tuned(
        1, 'loop', 'must agree with one that the filter is surer of than it should be',
        'benchmarks/slam/look_alikes.py')
    agree: tuple[float, float] = tuned(
        (0.25, 0.05), 'm, rad', 'between two agreeing loops, plus what the odometry drifts',
        'shared logs')
    drift: tuple[float, float] = tuned(
        (0.02, 0.005), 'share, rad/m',
        'of the travel between two agreeing loops, that the odometry drifts', 'shared logs')
    recent: int = tuned(
        60, 'views', 'within which loops are compared', 'not measured')
    spanned: float = tuned(
        3.0, 'sigmas', 'of travel that agreeing loops span', 'benchmarks/slam/look_alikes.py')
    chi2: float = tuned(
        16.3, 'squared sigmas', '99.9 % of chi-square with 3 degrees of freedom', 'by design')
    place: float = tuned(
        1.2, 'm', 'a pose this near to an old view is at its place', 'not measured')


TUNING = LoopTuning()


class Estimate(Protocol):
    """What loop closure asks of the filter."""

    @property
    def poses(self) -> Array:
        """View poses T_map_view (n, 3)."""

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Mask (n,) of the views whose covariance is known."""

    def relative(self, i: int, j: int) -> tuple[Array, Array]:
        """Return the pose (3,) of view j seen from view i, and its covariance (3, 3)."""

    def innovation(self, constraint: Constraint) -> tuple[Array, Array]:
        """Return measured minus expected constraint (3,), and its covariance (3, 3)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    An old view to match against, the expected pose (3,) in it, and the 1-sigma window.

    A tie is no loop: it is wanted only where the surfaces overlap as expected. Elsewhere are the
    old places where the new view may lie as well, as far as the filter knows.
    """

    old: int
    expected: Array
    sigma: Array
    tie: bool = False
    elsewhere: tuple['Candidate', ...] = ()

    @property
    def sure(self) -> bool:
        """Whether the filter knows where the new view lies, to TUNING.sure."""
        return bool((self.sigma[:2] < TUNING.sure[0]).all() and self.sigma[2] < TUNING.sure[1])


@dataclass(frozen=True, eq=False)
class Loop:
    """
    A matched candidate: the constraint, and how well it agrees.

    It needs partners unless the filter was sure already, of which sigma [m] is the larger of two;
    it is unique if the view fits nowhere else nearly as well.
    """

    constraint: Constraint
    agreement: float
    sure: bool
    sigma: float = 0.0
    unique: bool = True


def centre(cloud: Cloud) -> Array:
    """Return the median point (2,) [m] of what a view saw, in its base frame."""
    return np.median(cloud.points, axis=0) if len(cloud) else np.zeros(2)


def candidates(new: int, ekf: Estimate, centres: Array, config: SlamConfig
               ) -> list[Candidate]:
    """
    Return the old views whose surface lies near that of view `new`; at most one per pass.

    Every view is also tried against the one some views before it: where their surfaces
    overlap, the tie keeps a path that meets no old place from bending.
    """
    last = new - config.loop_minimum_gap
    if last <= 0:
        return []
    poses = ekf.poses
    seen = _seen(poses[:last], centres[:last])
    distance = np.hypot(*(seen - apply(poses[new], centres[new][None])).T)
    distance += 0.5 * np.hypot(*(poses[:last, :2] - poses[new, :2]).T)
    distance[~ekf.kept[:last]] = np.inf
    farthest = config.loop_search_distance + TUNING.farthest
    chosen: list[Candidate] = []
    for old in np.argsort(distance, kind='stable'):
        if len(chosen) == TUNING.candidates or distance[old] > farthest:
            break
        if any(abs(old - c.old) < config.loop_minimum_gap for c in chosen):
            continue
        candidate = _candidate(int(old), new, ekf)
        if distance[old] < config.loop_search_distance + 2.0 * np.hypot(*candidate.sigma[:2]):
            chosen.append(candidate)
    span = new - max(TUNING.span, config.loop_minimum_gap)
    if span >= 0 and all(
            abs(span - c.old) >= config.loop_minimum_gap // 2 for c in chosen):
        chosen.append(replace(_candidate(span, new, ekf), tie=True))
    return [c if c.sure else replace(c, elsewhere=_elsewhere(c, new, last, ekf)) for c in chosen]


def _elsewhere(candidate: Candidate, new: int, last: int, ekf: Estimate
               ) -> tuple[Candidate, ...]:
    """Return old views, one at each place before view `last`, where view `new` may lie as well."""
    poses = ekf.poses
    distance = np.hypot(*(poses[:last, :2] - poses[new, :2]).T)
    reach = TUNING.place + 4.0 * np.hypot(*candidate.sigma[:2])
    views = np.flatnonzero(ekf.kept[:last] & (distance < reach))
    place = np.array([TUNING.place, TUNING.place, np.pi])   # and the way it looks
    square = np.floor(poses[views] / place).astype(int)
    _, first = np.unique(square, axis=0, return_index=True)
    possible = []
    for old in views[np.sort(first)]:
        expected, P = ekf.relative(int(old), new)
        if squared_mahalanobis(expected, P + np.diag(place) ** 2) < TUNING.chi2:
            possible.append(Candidate(int(old), expected, _sigmas(P)))
    return tuple(possible)


def _candidate(old: int, new: int, ekf: Estimate) -> Candidate:
    """Return the view `old`, with view `new` expected where the filter has it."""
    expected, P = ekf.relative(old, new)
    return Candidate(old, expected, _sigmas(P))


def _sigmas(P: Array) -> Array:
    """Return the sigmas (3,) of a covariance (3, 3)."""
    sigmas: Array = np.sqrt(np.maximum(np.diag(P), 0.0))
    return sigmas


def _seen(poses: Array, centres: Array) -> Array:
    """Return the centres (n, 2) placed by their views' poses (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    seen: Array = poses[:, :2] + np.column_stack([c * centres[:, 0] - s * centres[:, 1],
                                                  s * centres[:, 0] + c * centres[:, 1]])
    return seen


class LoopClosure:
    """Holds loops back until they are trusted."""

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._pending: list[Loop] = []

    def trusted(self, loop: Loop, ekf: Estimate) -> list[Constraint]:
        """Return the constraints that may enter the filter: this loop, and those it confirms."""
        y, S = ekf.innovation(loop.constraint)
        possible = squared_mahalanobis(y, S) < TUNING.chi2
        if loop.sure and possible:
            return [loop.constraint]
        self._pending = [p for p in self._pending
                         if loop.constraint.second - p.constraint.second <= TUNING.recent]
        if not loop.unique or not (loop.sure or possible):
            return []
        partners = [p for p in self._pending if agree(p.constraint, loop.constraint, ekf)]
        self._pending.append(loop)
        together = [*partners, loop]
        if (len(partners) < (TUNING.partners_near if loop.sure else TUNING.partners)
                or not (loop.sure or _far_enough(together, ekf))):
            return []
        self._pending = [p for p in self._pending if p not in together]
        return [p.constraint for p in together]


def _far_enough(loops: list[Loop], ekf: Estimate) -> bool:
    """Return whether the loops span so much travel that a right place would have shown itself."""
    seconds = [loop.constraint.second for loop in loops]
    return (_travel(min(seconds), max(seconds), ekf.poses)
            >= TUNING.spanned * max(loop.sigma for loop in loops))


def _travel(first: int, last: int, poses: Array) -> float:
    """Return the length [m] of the path through poses (n, 3) from one view to another."""
    return float(np.hypot(*np.diff(poses[first:last + 1, :2], axis=0).T).sum())


def agree(a: Constraint, b: Constraint, ekf: Estimate) -> bool:
    """Return whether two loops and the robot's path between them close to a ring."""
    if max(a.second, b.second) - min(a.second, b.second) < 1:
        return False
    poses = ekf.poses
    around = compose(compose(a.z, between(poses[a.second], poses[b.second])),
                     inverse(compose(between(poses[a.first], poses[b.first]), b.z)))
    travel = _travel(a.second, b.second, poses)
    return bool(np.hypot(around[0], around[1]) < TUNING.agree[0] + TUNING.drift[0] * travel
                and abs(wrap(around[2])) < TUNING.agree[1] + TUNING.drift[1] * travel)
