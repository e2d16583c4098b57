# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rivals of a hypothesis: others that lie elsewhere, and where more are looked for."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.fusion.measures import Evidence
from somfusion_ros.geometry import Array, place, wrap
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class RivalSettings:
    """Numbers that the choice of rivals was tuned with."""

    slides: tuple[float, ...] = tuned(
        (-4.0, -2.5, -1.6, -1.0, 1.0, 1.6, 2.5, 4.0), 'm',
        'steps along a corridor at which rivals are looked for',
        'benchmarks/fusion/calibration.py')
    apart: float = tuned(
        0.7, 'm', 'a rival lies further than this from the best, or', 'by design')
    turned: float = tuned(8.0, 'deg', 'is turned by more than this', 'by design')


RIVALS = RivalSettings()


def slides(pose: Array, axis: Array) -> Array:
    """Return poses (8, 3) beside a hypothesis (3,), along the direction (2,) fixed worst."""
    steps = np.zeros((len(RIVALS.slides), 3))
    steps[:, :2] = np.outer(RIVALS.slides, axis)
    return pose + steps


def rivals(poses: Array, evidence: list[Evidence], best: int, pivot: Array) -> Index:
    """List the hypotheses (B, 3) that lie elsewhere than the best, strongest first."""
    spot = place(poses, pivot[None])[:, :, 0].T
    apart = np.hypot(*(spot - spot[best]).T) > RIVALS.apart
    apart |= np.abs(wrap(poses[:, 2] - poses[best, 2])) > np.radians(RIVALS.turned)
    found = np.flatnonzero(apart)
    return found[np.argsort([-evidence[k].score for k in found], kind='stable')]
