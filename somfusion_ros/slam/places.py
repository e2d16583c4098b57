# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Known places: where a robot goes on from a view that it has, instead of adding a new one.

A view is added only where it shows something new (Ila et al. 2010). Where an old view's surface
explains the scan as well as the newest does, the robot goes on from the old view with nothing but
that match; what it knew of the way since is dropped, so that nothing is counted twice (Walter et
al. 2007).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, difference, squared_mahalanobis, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.handover import handed_over
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loop_matching import agreement_of
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class PlaceTuning:
    """When a place is known."""

    near: float = tuned(
        1.25, 'least travels', 'a view within this distance and turn is at the same place',
        'shared logs')
    enough: int = tuned(
        2, 'views', 'at one place, so that no more are added', 'shared logs')
    around: float = tuned(
        2.5, 'least travels', 'a view within this distance and turn lies around the place',
        'benchmarks/life.py')
    well: int = tuned(
        8, 'views', 'around a place, of two passes or more, so that one of the nearest explains '
        'what any other way through it shows', 'benchmarks/life.py')
    passes: int = tuned(
        2, 'passes', 'whose views lie around a place, so that one of the nearest explains it',
        'benchmarks/life.py')
    full: int = tuned(
        4, 'views', 'at one place, from which on a new one must show much that they do not',
        'benchmarks/life.py')
    loss_full: float = tuned(
        0.15, 'share of points', 'that an old surface may explain less than the newest, where '
        'the place is full', 'benchmarks/life.py')
    tried: int = tuned(
        3, 'views', 'nearest, of a full or well known place, that may explain the scan',
        'benchmarks/life.py')
    sure: tuple[float, float] = tuned(
        (0.15, 0.05), 'm, rad', 'sigma of the old view seen from the robot; beyond it the loop '
        'is not closed yet', 'shared logs')
    gate: float = tuned(
        16.3, 'squared sigmas', 'between where the match and the filter have the robot',
        'by design')
    loss: float = tuned(
        0.05, 'share of points', 'that the old surface may explain less than the newest',
        'shared logs')
    agreement: float = tuned(
        0.9, 'share of points', 'on the old surface among those on it or in free space; '
        'below, something has changed', 'shared logs')


TUNING = PlaceTuning()


@dataclass(frozen=True, eq=False)
class Expected:
    """An old view, the pose T_view_base (3,) expected in it, and its covariance (3, 3)."""

    view: int
    T_view_base: Array
    P: Array


@dataclass(frozen=True, eq=False)
class Explained:
    """
    An old view with the surface around it, and where a scan was found in it.

    T_view_base (3,) and its covariance P (3, 3); whole: whether the surface is all there is.
    """

    view: int
    local_map: LocalMap
    T_view_base: Array
    P: Array
    whole: bool


@dataclass(frozen=True)
class KnownPlace:
    """
    A place: the views that may explain a scan there, the likeliest first.

    here: how many of all are at the place itself; loss: share of its points that they may
    explain less than the newest views do.
    """

    views: tuple[int, ...]
    here: int
    loss: float


def known(pose: Array, poses: Array, usable: NDArray[np.bool_], often: bool, config: SlamConfig
          ) -> KnownPlace:
    """
    Return the place of a pose (3,); one without views where it is not known.

    Parameters
    ----------
    pose : (3,) of the robot
    poses : (n, 3) of the views
    usable : (n,) the views that count: not those that the robot has just added
    often : whether the robot has been there often, so that it need not have left views there
    """
    apart = distance(pose, poses, config)
    apart[~usable] = np.inf
    here, near = int(np.count_nonzero(apart < TUNING.near)), np.flatnonzero(apart < TUNING.around)
    around = len(near)
    passes = np.count_nonzero(np.diff(near, prepend=-np.inf) > config.loop_minimum_gap)
    nearest = tuple(np.argsort(apart)[:min(TUNING.tried, around)].tolist())
    if here >= TUNING.full or around >= TUNING.well:
        return KnownPlace(nearest, here, TUNING.loss_full)
    if passes >= TUNING.passes or often and around:
        return KnownPlace(nearest, here, TUNING.loss)
    return KnownPlace(nearest[:1] if here >= TUNING.enough else (), here, TUNING.loss)


def nearest_seen(pose: Array, poses: Array, clouds: Sequence[Cloud], config: SlamConfig) -> int:
    """Return the nearest of the views at poses (n, 3) that show anything."""
    apart = distance(pose, poses, config)
    apart[[not len(cloud) for cloud in clouds]] = np.inf
    return int(np.argmin(apart))


def distance(pose: Array, poses: Array, config: SlamConfig) -> Array:
    """Return how far (n,) poses (n, 3) are from one (3,), in least travels of a new view."""
    d = poses - pose
    away: Array = (np.hypot(d[:, 0], d[:, 1]) / config.minimum_travel_distance
                   + np.abs(wrap(d[:, 2])) / config.minimum_travel_heading)
    return away


def members(view: int, own: range, count: int) -> range:
    """Return up to `count` views around a view, of its own chain."""
    start = max(own.start, min(view - count // 2, own.stop - count))
    return range(start, min(own.stop, start + count))


def explain(expected: Expected, seen: Cloud, around: Callable[[int], LocalMap], least: float,
            config: SlamConfig) -> Explained | None:
    """
    Match a scan against an old view's surface; None where the view cannot tell.

    least is the share of the scan that it must explain.
    """
    sigma = np.sqrt(np.diag(expected.P))
    if sigma[:2].max() > TUNING.sure[0] or sigma[2] > TUNING.sure[1]:
        return None
    local_map = around(expected.view)
    match = register(seen, local_map, expected.T_view_base)
    y = difference(match.T_map_scan, expected.T_view_base)
    if match.inlier_ratio < config.doubtful_inlier_ratio or (
            squared_mahalanobis(y, expected.P + match.covariance) > TUNING.gate):
        return None
    whole = (match.inlier_ratio >= least
             and agreement_of(match, seen, local_map) >= TUNING.agreement)
    return Explained(expected.view, local_map,
                     *handed_over(match, expected.T_view_base, expected.P), whole)
