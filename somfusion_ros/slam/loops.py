# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop closure: which old places to try.

A candidate is an old view whose surface should lie near the new view's, by the filter's own
uncertainty.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, between, compose, squared_mahalanobis
from somfusion_ros.settings import tuned
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class LoopTuning:
    """Which old places are tried (doc/slam.md)."""

    candidates: int = tuned(
        2, 'passes', 'old ones that a new view is matched against', 'shared logs')
    span: int = tuned(
        20, 'views', 'back to which every view is tied, loop or not', 'shared logs')
    farthest: float = tuned(
        10.0, 'm', 'beyond the search distance, however uncertain the filter is', 'public logs')
    sure: tuple[float, float] = tuned(
        (0.25, 0.06), 'm, rad',
        'sigma up to which a match that passes the gate is believed at once',
        'benchmarks/slam/look_alikes.py')
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
    def parents(self) -> NDArray[np.intp]:
        """View that each view was added from, at least (n,)."""

    @property
    def begins(self) -> NDArray[np.intp]:
        """First views (m,) of the chains of views that follow one another."""

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


def centre(cloud: Cloud) -> Array:
    """Return the median point (2,) [m] of what a view saw, in its base frame."""
    return np.median(cloud.points, axis=0) if len(cloud) else np.zeros(2)


def candidates(new: int, ekf: Estimate, centres: Array, config: SlamConfig,
               supposed: Constraint | None = None) -> list[Candidate]:
    """
    Return the old views whose surface lies near that of view `new`; at most one per pass.

    Where a loop is supposed, but not believed yet, one more lies near where that has the view:
    what comes next must confirm it, however far off the filter is.

    Every view is also tried against the one some views before it: where their surfaces
    overlap, the tie keeps a path that meets no old place from bending.
    """
    last = new - config.loop_minimum_gap
    if last <= 0:
        return []
    poses = ekf.poses
    distance = _away(poses[new], centres[new], poses[:last], centres[:last])
    distance[~ekf.kept[:last] | _inherited(new, last, ekf, config)] = np.inf
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
    if supposed is not None:
        before = max(0, min(last, supposed.second - config.loop_minimum_gap))
        follows = _supposed(supposed, new, before, ekf, centres, config)
        if follows and all(abs(follows.old - c.old) >= config.loop_minimum_gap for c in chosen):
            chosen.append(follows)
    span = new - max(TUNING.span, config.loop_minimum_gap)
    if span >= 0 and all(
            abs(span - c.old) >= config.loop_minimum_gap // 2 for c in chosen):
        chosen.append(replace(_candidate(span, new, ekf), tie=True))
    return [c if c.sure else replace(c, elsewhere=_elsewhere(c, new, last, ekf)) for c in chosen]


def _supposed(loop: Constraint, new: int, last: int, ekf: Estimate, centres: Array,
              config: SlamConfig) -> Candidate | None:
    """Return the view before `last` that shows what view `new` shows if a loop is right."""
    poses = ekf.poses
    at = compose(poses[loop.first], compose(loop.z, between(poses[loop.second], poses[new])))
    distance = _away(at, centres[new], poses[:last], centres[:last])
    distance[~ekf.kept[:last]] = np.inf
    if distance.min(initial=np.inf) > config.loop_search_distance + TUNING.farthest:
        return None
    old = int(np.argmin(distance))
    candidate = _candidate(old, new, ekf)
    # A filter that is sure needs none, and believes what it is surer of than it should be.
    return None if candidate.sure else replace(candidate, expected=between(poses[old], at))


def _away(pose: Array, centre_seen: Array, poses: Array, centres: Array) -> Array:
    """Return how far (n,) [m] old views, and more so what they saw, are from those of a view."""
    distance = np.hypot(*(_seen(poses, centres) - apply(pose, centre_seen[None])).T)
    return np.asarray(distance + 0.5 * np.hypot(*(poses[:, :2] - pose[:2]).T))


def _inherited(new: int, last: int, ekf: Estimate, config: SlamConfig) -> NDArray[np.bool_]:
    """
    Mask (last,) of the views that view `new` was matched against not long ago.

    A loop with them would count the same match twice. Where its chain has begun of late, they are
    those around the view that the chain was begun from.
    """
    inherited = np.zeros(last, bool)
    begun = int(ekf.begins[np.searchsorted(ekf.begins, new, side='right') - 1])
    if 0 < begun and new - begun < config.loop_minimum_gap:
        parent, gap = int(ekf.parents[begun]), config.loop_minimum_gap
        inherited[max(0, parent - gap):parent + gap + 1] = True
    return inherited


def _elsewhere(candidate: Candidate, new: int, last: int, ekf: Estimate
               ) -> tuple[Candidate, ...]:
    """Return old views, one at each place before view `last`, where view `new` may lie as well."""
    poses = ekf.poses
    at = compose(poses[candidate.old], candidate.expected)
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
            possible.append(Candidate(int(old), between(poses[old], at), _sigmas(P)))
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
