# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One map in, its clusters with norms out: the first half of the paper's pipeline in order."""

from weakref import WeakKeyDictionary

import numpy as np
from somfusion_ros.fusion import normals, orientation, rasters, segmentation, som
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.features import Clusters, Index, Map, Raster
from somfusion_ros.fusion.segment_cache import SegmentMemory
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid

DUST = 4             # a segment of fewer cells is noise
NORMED = 0.3         # agreement of the surfaces around a cluster from which it has a norm
SKETCH = 160         # features that stand for a map where every hypothesis is looked at
RADON = 300          # features that the Radon image is made of
CELL = 0.1           # edge of the zones' cells [m]
FINE = 0.05          # edge of the likelihood field's cells, more where the grid's are larger [m]
REACH = 1.3          # furthest that a match may be, and the rasters' cells [m]
PROBES = 1000        # wall cells that stand for all
FREE = 2000          # free places that stand for all free cells
_memory = SegmentMemory()
_learned: WeakKeyDictionary[Grid, dict[FusionConfig, Map]] = WeakKeyDictionary()


def learn(grid: Grid, config: FusionConfig | None = None) -> Map:
    """
    Learn one map; a map without walls gives a Map without features.

    The result is kept with the Grid object, so that the same object is not learned twice.
    """
    config = config or FusionConfig()
    known = _learned.setdefault(grid, {})
    if config not in known:
        known[config] = _learn(grid, config)
    return known[config]


def _learn(grid: Grid, config: FusionConfig) -> Map:
    """Segment, cluster, find the norms, and draw the rasters that the later stages ask."""
    cells, segments = _segments(grid, config)
    if len(cells) == 0:
        return _empty(grid)
    points = grid.cell_to_point(cells)
    times = som.presentations(grid.evidence[cells[:, 0], cells[:, 1]], config.presentation_step)
    centres, of, edges, winner = _memory.train(points, times, segments,
                                               config.cluster_spacing)
    surfaces, point, straight, sided = _norms(grid, centres, edges)
    share = np.bincount(winner, minlength=len(centres)) * grid.resolution / config.cluster_spacing
    clusters = Clusters(centres, np.minimum(share, 1.0) * config.cluster_spacing, of, edges,
                        point, straight, sided)
    features = clusters.take(np.flatnonzero(straight > NORMED))
    if len(features) == 0:
        return _empty(grid, points, segments, winner, clusters)
    order = np.argsort(-features.weights * features.straight, kind='stable')
    sketch = features.take(order[::max(1, len(order) // SKETCH)])
    walls = features.take(order[:RADON])
    zones = rasters.zones(grid, cells, CELL)
    image = orientation.radon(walls.centres, walls.weights, orientation.directions(), CELL)
    every = -(-len(points) // PROBES)
    return Map(points, segments, winner, clusters, surfaces, features, sketch, zones,
               rasters.nearby(features.centres, 2.0 * CELL, REACH),
               rasters.likelihood(points, max(grid.resolution, FINE)), points[::every],
               every * grid.resolution, rasters.free_places(zones, FREE),
               orientation.histogram(*surfaces), orientation.spectrum(image), grid.resolution)


def _segments(grid: Grid, config: FusionConfig) -> tuple[Index, Index]:
    """Wall cells (N, 2) as (row, column) and their segments (N,), without dust."""
    cells = np.column_stack(np.divmod(np.flatnonzero(grid.occupied), grid.shape[1]))
    radius = max(1.5, config.segment_radius / grid.resolution)
    labels = segmentation.segment(cells, grid.shape, radius)
    solid = np.bincount(labels, minlength=1)[labels] >= DUST
    return cells[solid], labels[solid]


def _norms(grid: Grid, centres: Array, edges: Index
           ) -> tuple[tuple[Array, Array, Array], Array, Array, Array]:
    """Surface norms with length and sidedness; point norms, their straightness, sidedness."""
    surface, length = normals.surface_norms(centres, edges)
    point, straight = normals.point_norms(surface, length, edges, len(centres))
    point, sided = normals.free_side(grid, centres, point)
    surface, surface_sided = normals.free_side(grid, centres[edges].mean(1), surface)
    return (surface, length, surface_sided), point, straight, sided


def _empty(grid: Grid, points: Array | None = None, segments: Index | None = None,
           winner: Index | None = None, clusters: Clusters | None = None) -> Map:
    """Return a map without features."""
    none, number, index = np.empty((0, 2)), np.empty(0), np.empty(0, np.intp)
    nothing = Clusters(none, number, index, np.empty((0, 2), np.intp), none, number, number)
    raster = Raster(np.zeros((1, 1), np.uint8), 1.0, Pose(), 0)
    return Map(none if points is None else points, index if segments is None else segments,
               index if winner is None else winner, clusters or nothing, (none, number, number),
               nothing, nothing, raster, raster, raster, none, 0.0, none,
               np.zeros(orientation.BINS), np.zeros(len(orientation.directions())),
               grid.resolution)
