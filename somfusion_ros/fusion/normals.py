# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface normals between adjacent clusters and point normals of clusters (section II-C, Fig. 4).

A surface normal stands upright on the line between two adjacent clusters; a point normal is the
average of the surface normals around the cluster, an end takes its only surface's. The side of a
wall that is free decides the sign, where only one side is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned

Index = NDArray[np.intp]


@dataclass(frozen=True)
class NormalSettings:
    """Numbers that the sign of the normals was tuned with."""

    probes: tuple[int, ...] = tuned(
        (2, 3, 4, 5), 'cells',
        'from the wall at which its sides are looked at: beyond a thick wall',
        'by design')
    wall_counts: float = tuned(
        -0.2, 'evidence',
        'that a wall beside the wall counts for, hardly less than unknown',
        'by design')


NORMALS = NormalSettings()


def surface_normals(centres: Array, edges: Index) -> tuple[Array, Array]:
    """Return unit normals (E, 2) of the surfaces between clusters, and their lengths (E,) [m]."""
    along = centres[edges[:, 1]] - centres[edges[:, 0]]
    length = np.hypot(*along.T)
    return np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(length, 1e-9)[:, None], length


def point_normals(normals: Array, lengths: Array, edges: Index, count: int) -> tuple[Array, Array]:
    """
    Average the surface normals around each cluster.

    Normals of opposite sign are the same surface, so the average is taken on doubled angles.

    Returns
    -------
    (K, 2) unit normals, zero without a surface, and (K,) 0..1, how well the surfaces agree
    """
    doubled = np.exp(2j * np.arctan2(normals[:, 1], normals[:, 0])) * lengths
    total, size = np.zeros(count, complex), np.zeros(count)
    for end in (0, 1):
        total += (np.bincount(edges[:, end], doubled.real, count)
                  + 1j * np.bincount(edges[:, end], doubled.imag, count))
        size += np.bincount(edges[:, end], lengths, count)
    straight = np.abs(total) / np.maximum(size, 1e-9)
    angle = np.angle(total) / 2.0
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.where(straight[:, None] > 0, unit, 0.0), straight


def free_side(grid: Grid, points: Array, normals: Array) -> tuple[Array, Array]:
    """
    Turn normals (N, 2) at points (N, 2) [m] towards free space.

    Returns
    -------
    (N, 2) normals and (N,) 0..1, how much freer that side is than the other
    """
    probes = np.array(NORMALS.probes, np.float32)
    steps = np.float32(grid.resolution) * np.concatenate([probes, -probes])
    probed = points.T[:, None] + steps[:, None] * normals.T[:, None]
    raster = Raster(grid.evidence, grid.resolution, grid.T_frame_grid, 0.0)
    evidence = raster.at(probed.astype(np.float32)).reshape(2, len(NORMALS.probes), len(points))
    ahead, behind = np.maximum(evidence, NORMALS.wall_counts).mean(1)
    sign = np.where(ahead < behind, -1.0, 1.0)
    return normals * sign[:, None], np.clip(np.abs(ahead - behind), 0.0, 1.0)
