# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surface that a few neighbouring views saw together: what a scan is matched against."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
from kiss_icp.pybind import kiss_icp_pybind
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from somfusion_ros.geometry import Array, rotation
from somfusion_ros.settings import tuned
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.surface import Surface


@dataclass(frozen=True)
class LocalMapTuning:
    """Rasters and voxels of a local map."""

    voxel: float = tuned(
        0.25, 'm', 'edge of a voxel of kiss-icp', 'shared logs')
    field_step: float = tuned(
        0.05, 'm', 'cell of the likelihood field', 'shared logs')
    field_sigma: float = tuned(
        0.08, 'm', 'spread of the likelihood around a surface point', 'shared logs')
    free_step: float = tuned(
        0.1, 'm', 'cell of the raster of free space', 'not measured')
    field_margin: float = tuned(
        0.5, 'm', 'empty field around the points', 'by design')


TUNING = LocalMapTuning()
POINTS_PER_VOXEL = 40   # kiss-icp then keeps points 0.04 m apart
PARTS = 32              # of a cell, by which the likelihood is tabled
LIKELIHOOD = np.rint(255.0 * np.exp(-0.5 * (
    np.arange(256) / PARTS * TUNING.field_step / TUNING.field_sigma) ** 2)).astype(np.uint8)


class LocalMap(Surface):
    """
    Points (N, 2) [m] with normals (N, 2) in one frame, with a tree and a likelihood field.

    Tree and field are built on first use; the map is never changed after.
    """

    def __init__(self, points: Array, normals: Array, rims: Iterable[Array] = ()) -> None:
        self.points, self.normals, self._rims = points, normals, rims

    @classmethod
    def of_views(cls, clouds: Sequence[Cloud], poses: Sequence[Array]) -> 'LocalMap':
        """Join clouds, each at its pose (3,) in the local map's frame; some show nothing."""
        shown = [(view, rotation(pose[2]).T, pose[:2])
                 for view, pose in zip(clouds, poses, strict=True) if len(view)]
        if not shown:
            return cls(np.empty((0, 2)), np.empty((0, 2)))
        points = [view.points @ turn + at for view, turn, at in shown]
        normals = [view.normals @ turn for view, turn, _ in shown]
        # Few local maps are asked for the space that was seen through.
        rims = (view.outline.rim @ turn + at for view, turn, at in shown)
        return cls(np.concatenate(points), np.concatenate(normals), rims)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the points."""
        return cKDTree(self.points, balanced_tree=False, compact_nodes=False)

    @cached_property
    def voxels(self) -> object:
        """The points as kiss-icp's voxel map, fine enough for walls."""
        voxels = kiss_icp_pybind._VoxelHashMap(
            voxel_size=TUNING.voxel, max_distance=1e3, max_points_per_voxel=POINTS_PER_VOXEL)
        voxels._add_points(lift(self.points))
        return voxels

    def seen_through(self, points: Array) -> NDArray[np.bool_]:
        """Return which points (N, 2) lie in space that the views' beams passed."""
        mask, corner = self._free
        cells = np.floor((points - corner) / TUNING.free_step).astype(np.intp)
        height, width = mask.shape
        x, y = cells.T
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        seen: NDArray[np.bool_] = mask[np.where(inside, y, 0), np.where(inside, x, 0)] > 0
        seen[~inside] = False
        return seen

    @cached_property
    def _free(self) -> tuple[NDArray[np.uint8], Array]:
        """Raster of the space that the beams passed, and its corner [m]."""
        return _fill(self._rims)

    @cached_property
    def field(self) -> tuple[NDArray[np.uint8], Array]:
        """Likelihood (H, W), 255 for 1, by distance to the nearest point, and its corner [m]."""
        corner = self.points.min(0) - TUNING.field_margin
        extent = self.points.max(0) + TUNING.field_margin - corner
        size = np.ceil(extent / TUNING.field_step).astype(int) + 1
        empty = np.ones(size[::-1], np.uint8)
        cells = ((self.points - corner) / TUNING.field_step).astype(np.intp)
        empty[cells[:, 1], cells[:, 0]] = 0
        distance = cv2.distanceTransform(empty, cv2.DIST_L2, 3)
        steps = cv2.convertScaleAbs(distance, alpha=PARTS)
        return np.asarray(cv2.LUT(steps, LIKELIHOOD), np.uint8), corner


def lift(points: Array) -> object:
    """Return the planar points (N, 2) as kiss-icp's vector of 3-D points with z = 0."""
    return kiss_icp_pybind._Vector3dVector(np.column_stack([points, np.zeros(len(points))]))


def _fill(rims: Iterable[Array]) -> tuple[NDArray[np.uint8], Array]:
    """Mask (H, W) of the cells that polygons (M, 2) cover, and its corner [m]."""
    rims = [rim for rim in rims if len(rim)] or [np.zeros((1, 2))]
    every = np.concatenate(rims)
    corner = every.min(0)
    size = np.ceil((every.max(0) - corner) / TUNING.free_step).astype(int) + 1
    mask = np.zeros(size[::-1], np.uint8)
    for rim in rims:
        cv2.fillPoly(mask, [np.rint((rim - corner) / TUNING.free_step - 0.5).astype(np.int32)], 1)
    return mask, corner
