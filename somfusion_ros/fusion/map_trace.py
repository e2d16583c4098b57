# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was learned of one map, laid out for figures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion import orientation
from somfusion_ros.fusion.features import Map
from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False)
class MapTrace:
    """
    What was learned of one map, for figures.

    segments: one array (N, 2) of wall cells [m] per segment; labels (M,) segment of each of the
    cells (M, 2) [m]; clusters (K, 2) [m] with norms (K, 2), cluster_segments (K,) and weights
    (K,) [m]; histogram (360,) of norms; radon image (D, offsets) over radon_directions (D,) [rad]
    and the sharpness (D,) whose peaks tune the orientation.
    """

    segments: list[Array]
    cells: Array
    labels: NDArray[np.intp]
    clusters: Array
    norms: Array
    cluster_segments: NDArray[np.intp]
    weights: Array
    histogram: Array
    radon: Array
    radon_directions: Array
    radon_sharpness: Array


def map_trace(one: Map) -> MapTrace:
    """Collect what figures show of one map."""
    order = np.argsort(one.segments, kind='stable')
    starts = np.flatnonzero(np.diff(one.segments[order])) + 1
    directions = orientation.directions()
    image = np.zeros((len(directions), 1))
    if len(one.features):
        image = orientation.radon(one.features.centres, one.features.weights, directions, 0.1)
    return MapTrace(np.split(one.cells[order], starts), one.cells, one.segments,
                    one.clusters.centres, one.clusters.norms, one.clusters.segments,
                    one.clusters.weights, one.histogram, image, directions,
                    orientation.spectrum(image))
