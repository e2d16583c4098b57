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

import numpy as np

from somfusion_ros.fusion.features import lattice_shares, Map, match_at, place, Warp
from somfusion_ros.geometry import Array

SPACING = 4.0         # edge of the lattice's cells, more where that makes too many [m]
MOST = 60             # nodes at most
REACHES = (1.0, 0.7, 0.5, 0.4, 0.3)    # furthest match in each step [m]
ANGLES = np.radians([25.0, 22.0, 20.0, 18.0, 15.0])
SCALE = 0.15          # distance at which a match has lost half of its pull [m]
STRETCH, SHEAR, BEND, SHIFT = 3.0, 2.0, 0.3, 0.05    # stiffness, in metres of matched wall


def bend(pose: Array, target: Map, source: Map) -> Warp:
    """Find the smooth warp that lays the source, placed by a pose (3,), onto the target."""
    at = place(np.asarray(pose)[None], source.features.centres)
    low, high = at[:, 0].min(1) - 0.1, at[:, 0].max(1) + 0.1
    spacing = max(SPACING, float(np.sqrt(np.prod(high - low) / MOST)))
    columns, rows = np.ceil((high - low) / spacing).astype(int) + 1
    index, share = lattice_shares(at[:, 0], low, spacing, (rows, columns))
    stiffness = _stiffness(rows, columns, spacing)
    nodes = rows * columns
    basis = np.zeros((at.shape[2], nodes), np.float32)
    for node, part in zip(index, share, strict=True):
        basis[np.arange(at.shape[2]), node] += part
    u = np.zeros((nodes, 2))
    weights = (source.features.weights * source.features.straight).astype(np.float32)
    for angle, reach in zip(ANGLES, REACHES, strict=True):
        here = at[:, 0] + (basis @ u).T
        found = match_at(here[:, None], pose[2:], source.features, target.features,
                         target.nearest, angle, reach)
        used = np.flatnonzero(found.agrees[0])
        if len(used) < 3:
            break
        off, norm = found.off[0, used], found.norms[:, 0, used]
        pull = weights[used] / (1.0 + (off / SCALE) ** 2)
        J = np.concatenate([basis[used] * norm[0, :, None], basis[used] * norm[1, :, None]], 1)
        wanted = off + np.einsum('in,ni->n', norm, (basis[used] @ u))
        Jw = J * pull[:, None]
        u = np.linalg.solve((Jw.T @ J).astype(float) + stiffness, Jw.T @ wanted)
        u = u.reshape(2, nodes).T
    return Warp(u.reshape(rows, columns, 2).astype(np.float32), low, spacing)


def _stiffness(rows: int, columns: int, spacing: float) -> Array:
    """Quadratic form (2 n, 2 n) of a warp's stretch, shear and bending, x before y."""
    def steps(count: int, order: int) -> Array:
        return np.diff(np.eye(count), n=order, axis=0) / spacing ** order
    along_x, along_y = np.kron(np.eye(rows), steps(columns, 1)), np.kron(steps(rows, 1),
                                                                         np.eye(columns))
    none_x, none_y = np.zeros_like(along_x), np.zeros_like(along_y)
    mid = 0.5 * np.abs(steps(rows, 1) * spacing), 0.5 * np.abs(steps(columns, 1) * spacing)
    across = (np.kron(mid[0], steps(columns, 1)), np.kron(steps(rows, 1), mid[1]))
    forms = [(STRETCH, np.hstack([along_x, none_x])), (STRETCH, np.hstack([none_y, along_y])),
             (SHEAR, np.hstack([across[1], across[0]]))]
    for curve in (np.kron(np.eye(rows), steps(columns, 2)), np.kron(steps(rows, 2),
                                                                    np.eye(columns))):
        if len(curve):
            still = np.zeros_like(curve)
            forms += [(BEND * spacing ** 2, np.hstack([curve, still])),
                      (BEND * spacing ** 2, np.hstack([still, curve]))]
    return SHIFT * np.eye(2 * rows * columns) + sum(
        weight * form.T @ form for weight, form in forms)
