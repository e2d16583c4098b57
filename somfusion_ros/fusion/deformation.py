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

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.cluster_matching import match_at
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.warp import lattice_shares, Warp
from somfusion_ros.geometry import apply, Array, fit, place
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class DeformationSettings:
    """Numbers that the elastic match was tuned with."""

    spacing: float = tuned(
        4.0, 'm', "edge of the lattice's cells, more where that makes too many nodes: a robot's "
        'drift does not bend a room', 'benchmarks/fusion/calibration.py')
    nodes: int = tuned(60, 'nodes', 'of the lattice at most: bounds the time', 'by design')
    reaches: tuple[float, ...] = tuned(
        (1.0, 0.6, 0.4, 0.3), 'm', 'furthest match in each step',
        'benchmarks/fusion/calibration.py')
    angles: tuple[float, ...] = tuned(
        (25.0, 20.0, 18.0, 15.0), 'deg', 'most between the normals of a match in each step',
        'by design')
    clusters: int = tuned(500, 'clusters', 'decide; more only cost time', 'by design')
    half_pull: float = tuned(
        0.15, 'm', 'distance at which a match has lost half of its pull',
        'benchmarks/fusion/calibration.py')
    stretch: float = tuned(
        3.0, 'm of wall', "stiffness against stretching, the dearest: a robot's own map keeps its "
        'lengths', 'benchmarks/fusion/calibration.py')
    shear: float = tuned(
        2.0, 'm of wall', 'stiffness against shear', 'benchmarks/fusion/calibration.py')
    bend: float = tuned(
        0.3, 'm of wall', 'stiffness against bending, the cheapest: headings drift',
        'benchmarks/fusion/calibration.py')
    shift: float = tuned(
        0.05, 'm of wall', 'stiffness against any displacement, so that parts without matches '
        'stay', 'by design')


DEFORMATION = DeformationSettings()


@dataclass(frozen=True, eq=False, kw_only=True)
class Deformation:
    """
    How two maps are bent against one another.

    warp: displacements of the source, placed by the pose that it started from, in the target's
    frame; pose (3,): the rigid pose that comes nearest to the whole motion; strain: root mean
    square of the displacements that it leaves [m]; scale: of the source's lengths, less one.
    """

    warp: Warp
    pose: Array
    strain: float
    scale: float


def bend(pose: Array, target: LearnedMap, source: LearnedMap) -> Deformation:
    """Find the smooth warp that lays the source, placed by a pose (3,), onto the target."""
    every = -(-len(source.features) // DEFORMATION.clusters)
    clusters = source.features.take(np.arange(0, len(source.features), every))
    start = place(np.asarray(pose)[None], clusters.centres)[:, 0]
    low, high = start.min(1) - 0.1, start.max(1) + 0.1
    spacing = max(DEFORMATION.spacing, float(np.sqrt(np.prod(high - low) / DEFORMATION.nodes)))
    columns, rows = np.ceil((high - low) / spacing).astype(int) + 1
    stiffness = _stiffness(int(rows), int(columns)) / spacing ** 2
    stiffness = stiffness + DEFORMATION.shift * np.eye(len(stiffness))
    stiffness *= len(clusters) / len(source.features)
    basis = np.zeros((len(clusters), rows * columns), np.float32)
    for node, part in zip(*lattice_shares(start, low, spacing, (rows, columns)), strict=True):
        basis[np.arange(len(clusters)), node] += part
    weights = (clusters.weights * clusters.straight).astype(np.float32)
    u = np.zeros((2, rows * columns), np.float32)
    for angle, reach in zip(np.radians(DEFORMATION.angles), DEFORMATION.reaches, strict=True):
        moved = u @ basis.T
        found = match_at((start + moved)[:, None], pose[2:], clusters, target.features,
                         target.nearest, angle, reach)
        off, normal = found.off[0], found.normals[:, 0]
        pull = found.agrees[0] * weights / (1.0 + (off / DEFORMATION.half_pull) ** 2)
        on = np.flatnonzero(pull)
        wanted = off + (normal * moved).sum(0)
        u = _solve(basis[on], normal[:, on], pull[on], wanted[on], stiffness)
    warp = Warp(np.ascontiguousarray(u.T).reshape(rows, columns, 2), low, spacing)
    return _deformation(warp, clusters.centres, start + u @ basis.T, pull)


def _deformation(warp: Warp, points: Array, moved: Array, weights: Array) -> Deformation:
    """Find the rigid part of a motion of points (K, 2) to places (2, K), where they match."""
    weights = weights + 1e-6      # a motion without a match has a rigid part, too
    nearest = fit(points, moved.T, weights)
    left = moved.T - apply(nearest, points)
    weights = weights / weights.sum()
    arms = apply(nearest, points) - weights @ apply(nearest, points)
    scale = (weights @ (arms * left).sum(1)) / max(weights @ (arms ** 2).sum(1), 1e-6)
    return Deformation(warp=warp, pose=np.array(nearest), scale=float(scale),
                       strain=float(np.sqrt(weights @ (left ** 2).sum(1))))


def _solve(basis: NDArray[np.float32], normal: Array, pull: Array, wanted: Array,
           stiffness: Array) -> NDArray[np.float32]:
    """Solve for the moves (2, n) of nodes that move points (M,) by `wanted` along normals."""
    root = np.sqrt(pull)
    rows = np.concatenate([basis.T * (root * across) for across in normal])
    H = stiffness + rows @ rows.T
    return np.linalg.solve(H, rows @ (root * wanted)).reshape(2, -1).astype(np.float32)


@lru_cache(maxsize=256)
def _stiffness(rows: int, columns: int) -> Array:
    """
    Return the quadratic form (2 n, 2 n) of a warp's stretch, shear and bending, x before y.

    For a lattice of unit spacing: it falls with the square of the spacing.
    """
    def steps(count: int, order: int) -> Array:
        return np.diff(np.eye(count), n=order, axis=0)
    along_x = np.kron(np.eye(rows), steps(columns, 1))
    along_y = np.kron(steps(rows, 1), np.eye(columns))
    none_x, none_y = np.zeros_like(along_x), np.zeros_like(along_y)
    mid = 0.5 * np.abs(steps(rows, 1)), 0.5 * np.abs(steps(columns, 1))
    across = np.kron(mid[0], steps(columns, 1)), np.kron(steps(rows, 1), mid[1])
    forms = [(DEFORMATION.stretch, np.hstack([along_x, none_x])),
             (DEFORMATION.stretch, np.hstack([none_y, along_y])),
             (DEFORMATION.shear, np.hstack([across[1], across[0]]))]
    for curve in (np.kron(np.eye(rows), steps(columns, 2)), np.kron(steps(rows, 2),
                                                                    np.eye(columns))):
        if len(curve):
            still = np.zeros_like(curve)
            forms += [(DEFORMATION.bend, np.hstack([curve, still])),
                      (DEFORMATION.bend, np.hstack([still, curve]))]
    return np.asarray(np.sum([weight * form.T @ form for weight, form in forms], axis=0))
