# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the merge knows of one map: a record that the stages fill and read."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.clusters import Clusters, Index
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Surfaces:
    """
    The edges between adjacent neurons of a map.

    normals (E, 2) unit; lengths (E,) [m]; sided (E,) 0..1, how sure the sign of the normal is.
    """

    normals: Array
    lengths: Array
    sided: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedMap:
    """
    One learned map.

    cells (N, 2) occupied cells' centres [m] with segment (N,) each; clusters, all neurons;
    surfaces between them; features: the clusters that have a normal; sketch: the few
    hundred best of them; structure (K,) 0..1, how much each feature is part of a long straight
    wall; zones: whether a place is wall, near one, known to be free (rasters.zones); clearance:
    how far the nearest place is that is not known to be free (rasters.clearance); nearest: index
    of the nearest feature, -1 for none; likelihood: field of the walls, 0..255; probes (P, 2): an
    even sample of the wall cells [m], each for `probe_length` of wall [m]; free (F, 2): an even
    sample of free places [m], each for `free_share` of area [m2]; histogram (360,) of normals;
    spectrum: Radon sharpness of half a turn; resolution of the grid [m].
    """

    cells: Array
    segments: Index
    clusters: Clusters
    surfaces: Surfaces
    features: Clusters
    sketch: Clusters
    structure: Array
    zones: Raster
    clearance: Raster
    nearest: Raster
    likelihood: Raster
    probes: Array
    probe_length: float
    free: Array
    free_share: float
    histogram: Array
    spectrum: Array
    resolution: float

    @property
    def pivot(self) -> Array:
        """Middle (2,) of the features [m], where poses are compared."""
        return np.asarray(self.features.centres.mean(0))
