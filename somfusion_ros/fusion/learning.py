# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One map in, its clusters with normals out: the first half of the paper's pipeline in order."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion import normals, orientation, rasters, segmentation, som
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters, Index
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap, Surfaces
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.fusion.structure import structure
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class LearningSettings:
    """Numbers that the learning of one map was tuned with."""

    dust: int = tuned(
        4, 'cells', 'a segment of fewer cells is noise', 'by design')
    shell: float = tuned(
        0.25, 'm', 'of a filled area, from its edge, that is taken for wall; 0.15 m of thick '
        'walls lose a pair', 'doc/verdict.md: filled areas')
    oriented: float = tuned(
        0.3, '0..1', 'agreement of the surfaces around a cluster from which it has a normal: '
        'below, it is a blob', 'benchmarks/fusion/stages.py')
    sketch: int = tuned(
        160, 'clusters', 'stand for a map where every hypothesis is looked at; 80 lose pairs of '
        'little overlap', 'benchmarks/fusion/stages.py')
    radon: int = tuned(
        300, 'clusters', 'the Radon image is made of; more change no peak',
        'benchmarks/fusion/stages.py')
    cell: float = tuned(
        0.1, 'm', "edge of the zones' cells: two cells of most maps", 'by design')
    fine_cell: float = tuned(
        0.05, 'm', "edge of the likelihood field's cells, more where the grid's are larger",
        'by design')
    reach: float = tuned(
        1.3, 'm', 'furthest match that is looked up: that of Algorithm 2 and a cell', 'by design')
    probes: int = tuned(
        1000, 'cells', 'stand for all wall cells in the verdict', 'benchmarks/fusion/stages.py')
    free_places: int = tuned(
        2000, 'places', 'stand for all free cells in V and the overlap',
        'benchmarks/fusion/stages.py')


LEARNING = LearningSettings()


def learn(grid: Grid, config: FusionConfig | None = None,
          cache: FusionCache | None = None) -> LearnedMap:
    """
    Learn one map; a map without walls gives a LearnedMap without features.

    With a cache, the result is kept for the Grid object, and segments that did not change since
    another map was learned are taken over.
    """
    config, cache = config or FusionConfig(), cache or FusionCache()
    known = cache.learned.setdefault(grid, {})
    if config not in known:
        known[config] = _learn(grid, config, cache)
    return known[config]


def recall(clusters: Clusters, resolution: float) -> LearnedMap:
    """Make as much of a map as its clusters tell, of which no place is known to be free."""
    features, sketch = _features(clusters)
    surfaces = Surfaces(normals=features.normals, lengths=features.weights, sided=features.sided)
    dark = Raster(np.zeros((1, 1), np.uint8), 1.0, Pose(), 0)
    return LearnedMap(
        cells=clusters.centres, segments=clusters.segments, clusters=clusters,
        surfaces=surfaces, features=features, sketch=sketch,
        structure=np.zeros(len(features)), zones=dark, clearance=dark,
        nearest=_nearest(features), likelihood=dark, probes=np.empty((0, 2)), probe_length=0.0,
        free=np.empty((0, 2)), free_share=0.0, histogram=histogram(surfaces),
        spectrum=spectrum(features), resolution=resolution)


def _learn(grid: Grid, config: FusionConfig, cache: FusionCache) -> LearnedMap:
    """Segment, cluster, find the normals, and draw the rasters that the later stages ask."""
    cells, segments = _segments(grid, config)
    if len(cells) == 0:
        return _empty(grid)
    points = grid.cell_to_point(cells)
    times = som.presentations(grid.evidence[cells[:, 0], cells[:, 1]], config.presentation_step)
    chains = cache.segments.train(points, times, segments, config.cluster_spacing)
    clusters, surfaces = _clusters(grid, chains, config.cluster_spacing)
    features, sketch = _features(clusters)
    if len(features) == 0:
        return _empty(grid, points, segments, clusters)
    zones, nearest = rasters.zones(grid, cells, LEARNING.cell), _nearest(features)
    free = rasters.free_places(zones, LEARNING.free_places)
    area = np.count_nonzero(zones.values & rasters.FREE) * zones.resolution ** 2
    every = -(-len(points) // LEARNING.probes)
    return LearnedMap(
        cells=points, segments=segments, clusters=clusters, surfaces=surfaces,
        features=features, sketch=sketch,
        structure=structure(features, nearest, config.cluster_spacing), zones=zones,
        clearance=rasters.clearance(zones), nearest=nearest,
        likelihood=rasters.likelihood(points, max(grid.resolution, LEARNING.fine_cell)),
        probes=points[::every], probe_length=every * grid.resolution,
        free=free, free_share=area / max(len(free), 1), histogram=histogram(surfaces),
        spectrum=spectrum(features), resolution=grid.resolution)


def _segments(grid: Grid, config: FusionConfig) -> tuple[Index, Index]:
    """Return the wall cells (N, 2) as (row, column) and their segments (N,), without dust."""
    cells = np.column_stack(np.divmod(np.flatnonzero(_shell(grid)), grid.shape[1]))
    radius = max(1.5, config.segment_radius / grid.resolution)
    labels = segmentation.segment(cells, grid.shape, radius)
    solid = np.bincount(labels, minlength=1)[labels] >= LEARNING.dust
    return cells[solid], labels[solid]


def _shell(grid: Grid) -> NDArray[np.bool_]:
    """
    Return the occupied cells (H, W) that a laser could have seen.

    Keep-out zones, and the outside of some maps, are filled: what is deep inside is no wall.
    """
    occupied = grid.occupied
    deep = int(max(2, round(LEARNING.shell / grid.resolution)))
    some = occupied[::deep, ::deep]     # of which a filled area holds four neighbours
    if not (some[1:, 1:] & some[1:, :-1] & some[:-1, 1:] & some[:-1, :-1]).any():
        return occupied
    inside = cv2.erode(occupied.astype(np.uint8), np.ones((2 * deep + 1,) * 2, np.uint8),
                       borderType=cv2.BORDER_CONSTANT, borderValue=1)
    shell: NDArray[np.bool_] = occupied & (inside == 0)
    return shell


def _clusters(grid: Grid, chains: tuple[Array, Index, Index, Index],
              spacing: float) -> tuple[Clusters, Surfaces]:
    """Give neurons their weights and normals, and the surfaces between them theirs."""
    centres, of, edges, winner = chains
    surface, lengths = normals.surface_normals(centres, edges)
    point, straight = normals.point_normals(surface, lengths, edges, len(centres))
    point, sided = normals.free_side(grid, centres, point)
    surface, surface_sided = normals.free_side(grid, centres[edges].mean(1), surface)
    share = np.bincount(winner, minlength=len(centres)) * grid.resolution / spacing
    clusters = Clusters(centres=centres, weights=np.minimum(share, 1.0) * spacing, segments=of,
                        edges=edges, normals=point, straight=straight, sided=sided)
    return clusters, Surfaces(normals=surface, lengths=lengths, sided=surface_sided)


def _features(clusters: Clusters) -> tuple[Clusters, Clusters]:
    """Return the clusters that have a normal, and an even choice of them, the best first."""
    features = clusters.take(np.flatnonzero(clusters.straight > LEARNING.oriented))
    order = _best(features)
    return features, features.take(order[::max(1, len(order) // LEARNING.sketch)])


def _best(features: Clusters) -> Index:
    """Order clusters by the straight wall that they stand for, the longest first."""
    return np.argsort(-features.weights * features.straight, kind='stable')


def _nearest(features: Clusters) -> Raster:
    """Draw the raster that knows the nearest feature."""
    return rasters.nearby(features.centres, 2.0 * LEARNING.cell, LEARNING.reach)


def histogram(surfaces: Surfaces) -> Array:
    """Count the surfaces' normals by direction."""
    return orientation.histogram(surfaces.normals, surfaces.lengths, surfaces.sided)


def spectrum(features: Clusters) -> Array:
    """Find how sharply the best walls project onto the lines of every direction."""
    walls = features.take(_best(features)[:LEARNING.radon])
    return orientation.spectrum(orientation.radon(
        walls.centres, walls.weights, orientation.directions(), LEARNING.cell))


def _empty(grid: Grid, points: Array | None = None, segments: Index | None = None,
           clusters: Clusters | None = None) -> LearnedMap:
    """Return a map without features."""
    none, index = np.empty((0, 2)), np.empty(0, np.intp)
    dark = Raster(np.zeros((1, 1), np.uint8), 1.0, Pose(), 0)
    return LearnedMap(
        cells=none if points is None else points, segments=index if segments is None else segments,
        clusters=clusters or Clusters.none(),
        surfaces=Surfaces(normals=none, lengths=np.empty(0), sided=np.empty(0)),
        features=Clusters.none(), sketch=Clusters.none(), structure=np.empty(0), zones=dark,
        clearance=dark, nearest=dark, likelihood=dark, probes=none, probe_length=0.0, free=none,
        free_share=0.0,
        histogram=np.zeros(orientation.BINS), spectrum=np.zeros(len(orientation.directions())),
        resolution=grid.resolution)
