# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mirror image of a learned map: a hall or a wing that is built the other way round."""

from dataclasses import replace

import numpy as np
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.learned_map import LearnedMap, Surfaces
from somfusion_ros.fusion.learning import histogram, spectrum
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import compose, Pose

FLIP = np.array([-1.0, 1.0])      # the image has x the other way


def mirror(one: LearnedMap) -> LearnedMap:
    """Return a learned map as if its grid had been mirrored at the y axis of its frame."""
    surfaces = Surfaces(normals=one.surfaces.normals * FLIP, lengths=one.surfaces.lengths,
                        sided=one.surfaces.sided)
    features = _clusters(one.features)
    return replace(
        one, cells=one.cells * FLIP, clusters=_clusters(one.clusters), surfaces=surfaces,
        features=features, sketch=_clusters(one.sketch), zones=_raster(one.zones),
        clearance=_raster(one.clearance), nearest=_raster(one.nearest),
        likelihood=_raster(one.likelihood), probes=one.probes * FLIP, free=one.free * FLIP,
        histogram=histogram(surfaces), spectrum=spectrum(features))


def _clusters(clusters: Clusters) -> Clusters:
    """Mirror clusters."""
    return replace(clusters, centres=clusters.centres * FLIP, normals=clusters.normals * FLIP)


def _raster(raster: Raster) -> Raster:
    """Mirror a raster: its columns run the other way from a corner on the other side."""
    x, y, theta = raster.T_frame_raster
    width = raster.values.shape[1] * raster.resolution
    corner = compose((-x, y, -theta), (-width, 0.0, 0.0))
    return replace(raster, values=np.ascontiguousarray(raster.values[:, ::-1]),
                   T_frame_raster=Pose.from_array(corner))
