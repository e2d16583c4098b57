# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surface that a few neighbouring views saw together: what a scan is matched against."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import cv2
from kiss_icp.pybind import kiss_icp_pybind
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from somfusion_ros.geometry import Array, rotation
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.surface import Surface

VOXEL, POINTS_PER_VOXEL = 0.25, 40  # kiss-icp then keeps points 0.04 m apart
FIELD_STEP = 0.05   # [m] cell of the likelihood field
FIELD_SIGMA = 0.08  # [m] spread of the likelihood around a surface point
PARTS = 32          # of a cell, by which the likelihood is tabled
FREE_STEP = 0.1     # [m] cell of the raster of free space
FIELD_MARGIN = 0.5  # [m] of empty field around the points
LIKELIHOOD = np.rint(255.0 * np.exp(
    -0.5 * (np.arange(256) / PARTS * FIELD_STEP / FIELD_SIGMA) ** 2)).astype(np.uint8)


class LocalMap(Surface):
    """
    Points (N, 2) [m] with normals (N, 2) in one frame, with a tree and a likelihood field.

    Tree and field are built on first use; the map is never changed after.
    """

    def __init__(self, points: Array, normals: Array, rims: Iterable[Array] = ()) -> None:
        self.points, self.normals, self._rims = points, normals, rims

    @classmethod
    def of_views(cls, clouds: Sequence[Cloud], poses: Sequence[Array]) -> 'LocalMap':
        """Put clouds together, each at its pose (3,) in the local map's frame."""
        if not clouds:
            return cls(np.empty((0, 2)), np.empty((0, 2)))
        turns = [rotation(pose[2]).T for pose in poses]
        points = [view.points @ turn + pose[:2]
                  for view, turn, pose in zip(clouds, turns, poses, strict=True)]
        normals = [view.normals @ turn for view, turn in zip(clouds, turns, strict=True)]
        # Few local maps are asked for the space that was seen through.
        rims = (view.outline.rim @ turn + pose[:2]
                for view, turn, pose in zip(clouds, turns, poses, strict=True))
        return cls(np.concatenate(points), np.concatenate(normals), rims)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the points."""
        return cKDTree(self.points, balanced_tree=False, compact_nodes=False)

    @cached_property
    def voxels(self) -> object:
        """The points as kiss-icp's voxel map, fine enough for walls."""
        voxels = kiss_icp_pybind._VoxelHashMap(
            voxel_size=VOXEL, max_distance=1e3, max_points_per_voxel=POINTS_PER_VOXEL)
        voxels._add_points(lift(self.points))
        return voxels

    def seen_through(self, points: Array) -> NDArray[np.bool_]:
        """Tell which points (N, 2) lie in space that the views' beams passed."""
        mask, corner = self._free
        cells = np.floor((points - corner) / FREE_STEP).astype(np.intp)
        inside = ((cells >= 0) & (cells < mask.shape[::-1])).all(1)
        cells = np.where(inside[:, None], cells, 0)
        return inside & (mask[cells[:, 1], cells[:, 0]] > 0)

    @cached_property
    def _free(self) -> tuple[NDArray[np.uint8], Array]:
        """Raster of the space that the beams passed, and its corner [m]."""
        return _fill(self._rims)

    @cached_property
    def field(self) -> tuple[NDArray[np.uint8], Array]:
        """Likelihood (H, W), 255 for 1, by distance to the nearest point, and its corner [m]."""
        corner = self.points.min(0) - FIELD_MARGIN
        size = np.ceil((self.points.max(0) + FIELD_MARGIN - corner) / FIELD_STEP).astype(int) + 1
        empty = np.ones(size[::-1], np.uint8)
        cells = ((self.points - corner) / FIELD_STEP).astype(np.intp)
        empty[cells[:, 1], cells[:, 0]] = 0
        distance = cv2.distanceTransform(empty, cv2.DIST_L2, 3)
        return cv2.LUT(cv2.convertScaleAbs(distance, alpha=PARTS), LIKELIHOOD), corner


def lift(points: Array) -> object:
    """Planar points (N, 2) as kiss-icp's vector of 3-D points with z = 0."""
    return kiss_icp_pybind._Vector3dVector(np.column_stack([points, np.zeros(len(points))]))


def _fill(rims: Iterable[Array]) -> tuple[NDArray[np.uint8], Array]:
    """Mask (H, W) of the cells of FREE_STEP that polygons (M, 2) cover, and its corner [m]."""
    rims = [rim for rim in rims if len(rim)] or [np.zeros((1, 2))]
    every = np.concatenate(rims)
    corner = every.min(0)
    size = np.ceil((every.max(0) - corner) / FREE_STEP).astype(int) + 1
    mask = np.zeros(size[::-1], np.uint8)
    for rim in rims:
        cv2.fillPoly(mask, [np.rint((rim - corner) / FREE_STEP - 0.5).astype(np.int32)], 1)
    return mask, corner
