# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether new views deny what old ones saw at the same place.

A robot that was carried to a place that looks alike goes on there with a good match, and what it
sees next stands in space that it knows to be free.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.settings import tuned
from somfusion_ros.slam.agreement import denies
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class ContradictionTuning:
    """When a robot is not where it seems to be."""

    near: float = tuned(
        1.5, 'm', 'from a new view, within which old views saw the same', 'by design')
    views: int = tuned(
        8, 'views', 'nearest, that are asked; 3 at least', 'not measured')
    sure: tuple[float, float] = tuned(
        (0.15, 0.05), 'm, rad', 'sigma of an old view seen from the new one; beyond it a loop is '
        'not closed yet', 'shared logs')
    times: int = tuned(
        4, 'views', 'that deny the old ones, with none between that agrees', 'shared logs')
    taken_back: int = tuned(
        40, 'views', 'at most, back to the last that agreed, that are taken out of the map',
        'test/unit/test_life.py')


TUNING = ContradictionTuning()


def denied(new: int, last: int, ekf: DelayedStateEkf, clouds: Sequence[Cloud]) -> bool | None:
    """Return whether view `new` denies views up to `last`; None where they have not seen it."""
    poses: Array = ekf.poses
    away = np.hypot(*(poses[:max(last, 0), :2] - poses[new, :2]).T)
    near = [int(k) for k in np.argsort(away)[:TUNING.views]
            if away[k] < TUNING.near and len(clouds[k])]
    if len(near) < 3:
        return None
    if not sure(near[0], new, ekf):
        return None
    around = LocalMap.of_views([clouds[k] for k in near], list(between(poses[new], poses[near])))
    return denies(np.zeros(3), clouds[new], around)


def sure(old: int, new: int, ekf: DelayedStateEkf) -> bool:
    """Return whether it is known well where a view is, seen from an old one."""
    sigma = np.sqrt(np.diag(ekf.relative(old, new)[1]))
    return bool(sigma[:2].max() <= TUNING.sure[0] and sigma[2] <= TUNING.sure[1])
