# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Norm-matched alignment of clusters (section III-B, Algorithm 2, equation (9)).

Every source cluster looks for the nearest target cluster; the two match if their point normals
differ by less than a threshold that falls from 25 to 4 degrees. Published, the map moves by the
mean shift of the matches. Here all seeds move at once, and along the normals only (point to line),
with a small turn: clusters of two maps sit at different places along the same wall.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.cluster_matching import match, Matches
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class TranslationSettings:
    """Numbers that Algorithm 2 was tuned with."""

    angles: tuple[float, ...] = tuned(
        (25.0, 18.0, 12.0, 7.0, 4.0), 'deg',
        'thresholds of Algorithm 2: from 25 to 4 degrees, as published',
        'by design')
    reaches: tuple[float, ...] = tuned(
        (1.2, 0.9, 0.6, 0.45, 0.3), 'm',
        'furthest match at each of them; further ones draw in the next wall',
        'benchmarks/fusion/stages.py')


TRANSLATION = TranslationSettings()


def mean_shift(pose: Array, source: Clusters, target: Clusters, nearest: Raster,
               angles: Array = np.radians(TRANSLATION.angles),
               steps: int = 8) -> tuple[Array, list[float]]:
    """
    Run Algorithm 2 as published: translation only, mean shift (9), 25 to 4 degrees.

    Returns the pose (3,) and the mean distance of the matches after each step [m], J of (10).
    """
    pose, index = np.array(pose, dtype=float), []
    for angle in np.repeat(angles, steps):
        found = match(pose[None], source, target, nearest, angle, np.inf)
        agrees = found.agrees[0]
        if not agrees.any():
            continue
        shift = target.centres[found.other[0, agrees]] - found.at[:, 0, agrees].T
        pose[:2] += shift.mean(0)
        index.append(float(np.hypot(shift[:, 0], shift[:, 1]).mean()))
    return pose, index


def settle(poses: Array, source: Clusters, target: Clusters, nearest: Raster,
           angles: Array = np.radians(TRANSLATION.angles),
           reaches: tuple[float, ...] = TRANSLATION.reaches) -> tuple[Array, Array]:
    """
    Let every seed (B, 3) fall into its nearest agreement.

    Returns poses (B, 3) and the mean distance to the matched lines before each step, (steps, B),
    the performance index J of (10) [m].
    """
    poses, index = np.array(poses, dtype=float), []
    for angle, reach in zip(angles, reaches, strict=True):
        found = match(poses, source, target, nearest, angle, reach)
        weight = found.agrees * np.minimum(source.table[4], found.weights)
        poses = _turn_about(poses, *_solve(found, weight))
        total = np.einsum('bk->b', weight)
        index.append(np.einsum('bk,bk->b', weight, np.abs(found.off)) / np.maximum(total, 1e-6))
    return poses, np.asarray(index)


def _solve(found: Matches, weight: Array) -> tuple[Array, Array]:
    """
    Return the weighted point-to-line step of each of B hypotheses.

    Returns steps (B, 3): shift [m] and turn [rad] about the pivots (B, 2), the weighted centres.
    """
    total = np.einsum('bk->b', weight) + 1e-6
    pivot = np.einsum('ibk,bk->bi', found.at, weight) / total[:, None]
    arm = found.at - pivot.T[:, :, None]
    J = (*found.normals, arm[0] * found.normals[1] - arm[1] * found.normals[0])
    H, g = np.empty((len(total), 3, 3)), np.empty((len(total), 3))
    for i, row in enumerate(J):
        pull = row * weight
        g[:, i] = np.einsum('bk,bk->b', pull, found.off)
        for j in range(i, 3):
            H[:, i, j] = H[:, j, i] = np.einsum('bk,bk->b', pull, J[j])
    # Damping: where no wall fixes a direction (a corridor), the hypothesis stays where it is.
    H += np.diag([0.02, 0.02, 0.08]) * total[:, None, None]
    return np.linalg.solve(H, g[..., None])[..., 0], pivot


def _turn_about(poses: Array, steps: Array, pivot: Array) -> Array:
    """Apply steps (B, 3) about pivots (B, 2) to poses (B, 3)."""
    arm = poses[:, :2] - pivot
    c, s = np.cos(steps[:, 2]), np.sin(steps[:, 2])
    return np.column_stack([pivot[:, 0] + c * arm[:, 0] - s * arm[:, 1] + steps[:, 0],
                            pivot[:, 1] + s * arm[:, 0] + c * arm[:, 1] + steps[:, 1],
                            poses[:, 2] + steps[:, 2]])
