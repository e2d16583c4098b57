# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SOM neurons with their norms as the rows of a point cloud, as RViz and Foxglove show them."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.features import Clusters
from somfusion_ros.fusion.learned_map import NORMED

CLUSTER_FIELDS = ('x', 'y', 'z', 'normal_x', 'normal_y', 'segment', 'weight')


def cluster_rows(clusters: Clusters) -> NDArray[np.float32]:
    """Rows (K, 7) of CLUSTER_FIELDS, one per SOM neuron; norms zero where unknown."""
    norms = clusters.norms * (clusters.straight > NORMED)[:, None]
    return np.column_stack([clusters.centres, np.zeros(len(clusters)), norms, clusters.segments,
                            clusters.weights]).astype(np.float32)
