# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Norm-matched alignment of clusters (section III-B, Algorithm 2, equation (9)).

Every source cluster looks for the nearest target cluster; the two match if their point norms
differ by less than a threshold that falls from 25 to 4 degrees. Published, the map moves by the
mean shift of the matches. Here all seeds move at once, and along the norms only (point to line),
with a small turn: clusters of two maps sit at different places along the same wall.
"""

import numpy as np

from somfusion_ros.fusion.features import Clusters, match, Raster
from somfusion_ros.geometry import Array

ANGLES = np.radians([25.0, 18.0, 13.0, 9.0, 6.0, 4.0])   # thresholds of Algorithm 2
REACHES = (1.2, 0.9, 0.7, 0.5, 0.4, 0.3)                 # furthest match at each [m]


def mean_shift(pose: Array, source: Clusters, target: Clusters, nearest: Raster,
               angles: Array = ANGLES, steps: int = 8) -> tuple[Array, list[float]]:
    """
    Algorithm 2 as published: translation only, mean shift (9), 25 to 4 degrees.

    Returns the pose (3,) and the mean distance of the matches after each step [m], J of (10).
    """
    pose, index = np.array(pose, dtype=float), []
    for angle in np.repeat(angles, steps):
        at, other, agrees = match(pose[None], source, target, nearest, angle, np.inf)
        if not agrees.any():
            continue
        shift = (target.centres[other] - at)[agrees]
        pose[:2] += shift.mean(0)
        index.append(float(np.hypot(*shift.T).mean()))
    return pose, index


def settle(poses: Array, source: Clusters, target: Clusters, nearest: Raster,
           angles: Array = ANGLES, reaches: tuple[float, ...] = REACHES) -> tuple[Array, Array]:
    """
    Let every seed (B, 3) fall into its nearest agreement.

    Returns poses (B, 3) and the mean distance to the matched lines after each step, (steps, B),
    the performance index J of (10) [m].
    """
    poses, index = np.array(poses, dtype=float), []
    for angle, reach in zip(angles, reaches):
        at, other, agrees = match(poses, source, target, nearest, angle, reach)
        norms = target.norms[other]
        weight = agrees * np.minimum(source.weights[None], target.weights[other])
        off = ((target.centres[other] - at) * norms).sum(-1)
        poses = turn_about(poses, *solve(at, norms, off, weight))
        index.append((weight * np.abs(off)).sum(1) / np.maximum(weight.sum(1), 1e-9))
    return poses, np.asarray(index)


def solve(at: Array, norms: Array, off: Array, weight: Array) -> tuple[Array, Array]:
    """
    Weighted point-to-line step of each of B hypotheses.

    at (B, K, 2), norms (B, K, 2), off (B, K) wanted moves along the norms, weight (B, K).

    Returns
    -------
    steps (B, 3): shift [m] and turn [rad] about the pivots (B, 2), the weighted centres
    """
    total = weight.sum(1) + 1e-9
    pivot = (at * weight[..., None]).sum(1) / total[:, None]
    arm = at - pivot[:, None]
    J = np.concatenate([norms, (arm[..., :1] * norms[..., 1:] - arm[..., 1:] * norms[..., :1])],
                       axis=-1)
    Jw = J * weight[..., None]
    H = np.swapaxes(Jw, 1, 2) @ J
    # Damping: where no wall fixes a direction (a corridor), the hypothesis stays where it is.
    H += np.eye(3) * (0.02 * total)[:, None, None] * (1.0, 1.0, 4.0)
    g = np.swapaxes(Jw, 1, 2) @ off[..., None]
    return np.linalg.solve(H, g)[..., 0], pivot


def turn_about(poses: Array, steps: Array, pivot: Array) -> Array:
    """Apply steps (B, 3) about pivots (B, 2) to poses (B, 3)."""
    arm = poses[:, :2] - pivot
    c, s = np.cos(steps[:, 2]), np.sin(steps[:, 2])
    return np.column_stack([pivot[:, 0] + c * arm[:, 0] - s * arm[:, 1] + steps[:, 0],
                            pivot[:, 1] + s * arm[:, 0] + c * arm[:, 1] + steps[:, 1],
                            poses[:, 2] + steps[:, 2]])
