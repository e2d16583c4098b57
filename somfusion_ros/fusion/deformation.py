# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How far two maps are bent against one another.

The maps of two real robots drift: in the right place, walls may lie half a metre apart at the
ends of the overlap. A smooth warp of few parameters makes them coincide; the walls of different
places do not come to coincide under the same warp. So the warp separates drift from being wrong.
It is a lattice of displacements: turning is free, bending is cheap, stretching is dear, as the
error of a robot's own map is.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.cluster_matching import match_at
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.warp import lattice_shares, Warp
from somfusion_ros.geometry import Array, place

SPACING = 4.0         # edge of the lattice's cells, more where that makes too many [m]
MOST = 60             # nodes at most
REACHES = (1.0, 0.6, 0.4, 0.3)    # furthest match in each step [m]
ANGLES = np.radians([25.0, 20.0, 18.0, 15.0])
ENOUGH = 500          # clusters that decide
SCALE = 0.15          # distance at which a match has lost half of its pull [m]
STRETCH, SHEAR, BEND, SHIFT = 3.0, 2.0, 0.3, 0.05    # stiffness, in metres of matched wall


def bend(pose: Array, target: LearnedMap, source: LearnedMap) -> Warp:
    """Find the smooth warp that lays the source, placed by a pose (3,), onto the target."""
    clusters = source.features
    clusters = clusters.take(np.arange(0, len(clusters), -(-len(clusters) // ENOUGH)))
    start = place(np.asarray(pose)[None], clusters.centres)[:, 0]
    low, high = start.min(1) - 0.1, start.max(1) + 0.1
    spacing = max(SPACING, float(np.sqrt(np.prod(high - low) / MOST)))
    columns, rows = np.ceil((high - low) / spacing).astype(int) + 1
    stiffness = _stiffness(int(rows), int(columns)) / spacing ** 2
    stiffness = stiffness + SHIFT * np.eye(len(stiffness))
    stiffness *= len(clusters) / len(source.features)
    basis = np.zeros((len(clusters), rows * columns), np.float32)
    for node, part in zip(*lattice_shares(start, low, spacing, (rows, columns)), strict=True):
        basis[np.arange(len(clusters)), node] += part
    weights = (clusters.weights * clusters.straight).astype(np.float32)
    u = np.zeros((2, rows * columns), np.float32)
    for angle, reach in zip(ANGLES, REACHES, strict=True):
        moved = u @ basis.T
        found = match_at((start + moved)[:, None], pose[2:], clusters, target.features,
                         target.nearest, angle, reach)
        off, normal = found.off[0], found.normals[:, 0]
        pull = found.agrees[0] * weights / (1.0 + (off / SCALE) ** 2)
        on = np.flatnonzero(pull)
        wanted = off + (normal * moved).sum(0)
        u = _solve(basis[on], normal[:, on], pull[on], wanted[on], stiffness)
    return Warp(np.ascontiguousarray(u.T).reshape(rows, columns, 2), low, spacing)


def _solve(basis: NDArray[np.float32], normal: Array, pull: Array, wanted: Array,
           stiffness: Array) -> NDArray[np.float32]:
    """Displacements (2, n) of the nodes that move points (M,) by `wanted` along their normals."""
    root = np.sqrt(pull)
    rows = np.concatenate([basis.T * (root * across) for across in normal])
    H = stiffness + rows @ rows.T
    return np.linalg.solve(H, rows @ (root * wanted)).reshape(2, -1).astype(np.float32)


@lru_cache(maxsize=256)
def _stiffness(rows: int, columns: int) -> Array:
    """
    Quadratic form (2 n, 2 n) of a warp's stretch, shear and bending, x before y.

    For a lattice of unit spacing: it falls with the square of the spacing.
    """
    def steps(count: int, order: int) -> Array:
        return np.diff(np.eye(count), n=order, axis=0)
    along_x = np.kron(np.eye(rows), steps(columns, 1))
    along_y = np.kron(steps(rows, 1), np.eye(columns))
    none_x, none_y = np.zeros_like(along_x), np.zeros_like(along_y)
    mid = 0.5 * np.abs(steps(rows, 1)), 0.5 * np.abs(steps(columns, 1))
    across = np.kron(mid[0], steps(columns, 1)), np.kron(steps(rows, 1), mid[1])
    forms = [(STRETCH, np.hstack([along_x, none_x])), (STRETCH, np.hstack([none_y, along_y])),
             (SHEAR, np.hstack([across[1], across[0]]))]
    for curve in (np.kron(np.eye(rows), steps(columns, 2)), np.kron(steps(rows, 2),
                                                                    np.eye(columns))):
        if len(curve):
            still = np.zeros_like(curve)
            forms += [(BEND, np.hstack([curve, still])), (BEND, np.hstack([still, curve]))]
    return sum(weight * form.T @ form for weight, form in forms)
