# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a trajectory agrees with a log's references: relations (Kuemmerle et al. 2009), ate."""

from pathlib import Path

import numpy as np
from somfusion_ros.geometry import apply, Array, between, fit

GRACE = 0.05   # [s] by which a reference may lie outside the trajectory


def score(folder: Path, stamps: Array, poses: Array) -> dict[str, float]:
    """Score stamps (n,) rising and poses (n, 3) by what references lie in a log's folder."""
    scores = {}
    if (folder / 'relations.txt').exists():
        rows = np.loadtxt(folder / 'relations.txt')
        first, second = (_at(stamps, poses, rows[:, k]) for k in (0, 1))
        error = between(rows[:, 2:5], between(first, second))
        distance = np.hypot(error[:, 0], error[:, 1])
        scores |= {'relations mean': np.nanmean(distance), 'median': np.nanmedian(distance)}
    if (folder / 'reference.tum').exists():
        rows = np.loadtxt(folder / 'reference.tum')
        known = _at(stamps, poses, rows[:, 0])[:, :2]
        seen = np.isfinite(known).all(1)
        placed = apply(fit(known[seen], rows[seen, 1:3]), known[seen])
        scores['ate'] = np.sqrt(((placed - rows[seen, 1:3]) ** 2).sum(1).mean())
    return {name: float(value) for name, value in scores.items()}


def _at(stamps: Array, poses: Array, when: Array) -> Array:
    """Poses (m, 3) at some times, NaN outside the trajectory."""
    found = np.column_stack([np.interp(when, stamps, part)
                             for part in (*poses[:, :2].T, np.unwrap(poses[:, 2]))])
    found[(when < stamps[0] - GRACE) | (when > stamps[-1] + GRACE)] = np.nan
    return found
