# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which clusters are part of long straight walls, and which of what can be moved."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class StructureSettings:
    """Numbers that telling walls from furniture was tuned with."""

    steps: int = tuned(
        8, 'clusters', 'that are looked for on either side along the wall; more add time, and a '
        'wall of this length is long enough', 'by design')
    gap: int = tuned(
        2, 'clusters', 'that may be missing: a door leaf, a person, a hole', 'by design')
    off: float = tuned(
        0.12, 'm', 'a cluster of a straight wall lies at most this far from its line: two cells '
        'of a bent map', 'by design')
    near: float = tuned(
        0.3, 'm', 'a cluster counts for a step along the wall if it lies this near: less than one '
        'cluster spacing', 'by design')
    angle: float = tuned(
        15.0, 'deg', 'most between the normals of a straight wall', 'by design')
    short: float = tuned(
        1.2, 'm', 'a straight piece up to this length may be furniture',
        'benchmarks/fusion/calibration.py')
    long: float = tuned(
        3.2, 'm', 'a straight piece from this length is wall', 'benchmarks/fusion/calibration.py')


STRUCTURE = StructureSettings()


def structure(clusters: Clusters, nearest: Raster, spacing: float) -> Array:
    """
    Tell how much each cluster is part of a long straight wall, (K,) 0..1.

    Along the tangent of a cluster, steps of a cluster's `spacing` [m] are followed both ways for
    as long as clusters lie there that face the same way.

    Parameters
    ----------
    clusters : K clusters with normals
    nearest : index of the nearest of them for any place
    spacing : distance of neighbouring clusters [m]
    """
    length = np.zeros(len(clusters))
    for way in (1.0, -1.0):
        found = _continued(clusters, nearest, way * spacing)
        missing = np.zeros(len(clusters), np.intp)
        going, reached = np.ones(len(clusters), bool), np.zeros(len(clusters))
        for step, here in enumerate(found, start=1):
            missing = np.where(here, 0, missing + 1)
            going &= missing <= STRUCTURE.gap
            reached = np.where(going & here, step * spacing, reached)
        length += reached
    return np.clip((length - STRUCTURE.short) / (STRUCTURE.long - STRUCTURE.short), 0.0, 1.0)


def _continued(clusters: Clusters, nearest: Raster, spacing: float) -> NDArray[np.bool_]:
    """Tell whether each wall goes on after each of so many steps along it, (steps, K)."""
    x, y, across, up = clusters.table[:4]
    steps = (spacing * np.arange(1, STRUCTURE.steps + 1, dtype=np.float32))[:, None]
    at = np.stack([x - steps * up, y + steps * across])
    other = nearest.at(at).astype(np.intp)
    # Index -1, for "none", reads the first cluster: harmless, it is masked.
    there = np.take(clusters.table[:4], other, axis=1, mode='clip')
    dx, dy = there[0] - at[0], there[1] - at[1]
    on = (other >= 0) & (dx * dx + dy * dy < STRUCTURE.near ** 2)
    on &= np.abs(dx * across + dy * up) < STRUCTURE.off
    on &= np.abs(there[2] * across + there[3] * up) > np.cos(np.radians(STRUCTURE.angle))
    return np.asarray(on)
