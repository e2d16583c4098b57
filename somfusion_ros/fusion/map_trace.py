# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was learned of one map, laid out for figures."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion import orientation
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class MapTrace:
    """
    What was learned of one map, for figures.

    segments: one array (N, 2) of wall cells [m] per segment; clusters (K, 2) [m] with normals
    (K, 2) and weights (K,) [m]; histogram (360,) of normals; radon image (D, offsets) over
    radon_directions (D,) [rad] and the sharpness (D,) whose peaks tune the orientation.
    """

    segments: list[Array]
    clusters: Array
    normals: Array
    weights: Array
    histogram: Array
    radon: Array
    radon_directions: Array
    radon_sharpness: Array


def map_trace(one: LearnedMap) -> MapTrace:
    """Collect what figures show of one map."""
    order = np.argsort(one.segments, kind='stable')
    starts = np.flatnonzero(np.diff(one.segments[order])) + 1
    directions = orientation.directions()
    image = np.zeros((len(directions), 1))
    if len(one.features):
        image = orientation.radon(one.features.centres, one.features.weights, directions, 0.1)
    return MapTrace(
        segments=np.split(one.cells[order], starts), clusters=one.clusters.centres,
        normals=one.clusters.normals, weights=one.clusters.weights, histogram=one.histogram,
        radon=image, radon_directions=directions,
        radon_sharpness=orientation.spectrum(image))
