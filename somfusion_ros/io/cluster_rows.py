# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SOM neurons with their normals as the rows of a point cloud, as RViz and Foxglove show them."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.learning import LEARNING

CLUSTER_FIELDS = ('x', 'y', 'z', 'normal_x', 'normal_y', 'segment', 'weight')


def cluster_rows(clusters: Clusters) -> NDArray[np.float32]:
    """Return the rows (K, 7) of CLUSTER_FIELDS, one per SOM neuron; normals zero where unknown."""
    normals = clusters.normals * (clusters.straight > LEARNING.oriented)[:, None]
    return np.column_stack([clusters.centres, np.zeros(len(clusters)), normals, clusters.segments,
                            clusters.weights]).astype(np.float32)
