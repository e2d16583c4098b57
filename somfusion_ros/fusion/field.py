# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rasters of a map: clearance from the walls, and the nearest feature, for any point at once."""

import cv2
import numpy as np

from somfusion_ros.fusion.features import Raster
from somfusion_ros.geometry import apply, Array, inverse, Pose
from somfusion_ros.grid import Grid

FREE = 0.5     # mean evidence from which a block of cells counts as free
BRIGHTEN = 2.5      # brings a straight wall of one cell back to full height after the blur


def clearance(grid: Grid, walls: Array, cell: float) -> Raster:
    """
    Distance to the next wall [m], negative where a cell is not known to be free.

    Parameters
    ----------
    walls : (N, 2) centres of the wall cells [m]
    cell : wanted edge of the raster's cells [m]; a whole multiple of the grid's is taken
    """
    factor = max(1, round(cell / grid.resolution))
    height, width = (max(1, side // factor) for side in grid.shape)
    block = grid.evidence[:height * factor, :width * factor]
    if min(block.shape) < factor:
        block = grid.evidence
    free = cv2.resize(block, (width, height), interpolation=cv2.INTER_AREA) > FREE
    size = grid.resolution * factor
    mark = _mark(walls, grid, size, (height, width))
    distance = cv2.distanceTransform(mark, cv2.DIST_L2, 5) * np.float32(size)
    signed = np.where(free | (mark == 0), distance, -distance)
    return Raster(signed, size, grid.T_frame_grid, -99.0)


def likelihood(points: Array, cell: float) -> Raster:
    """
    Likelihood field of walls: 255 on a wall of points (N, 2) [m], falling within two cells.

    A speck counts for less than a wall. Cells of edge `cell` [m] and a blur of one cell.
    """
    low = points.min(0) - 4.5 * cell     # so that cells of this size fall into the middle
    width, height = np.ceil((points.max(0) - low) / cell).astype(int) + 5
    x, y = ((points - low) / cell).astype(np.intp).T
    image = np.zeros((height, width), np.uint8)
    image[y, x] = 255
    blurred = cv2.GaussianBlur(image, (5, 5), 1.0)
    return Raster(cv2.convertScaleAbs(blurred, alpha=BRIGHTEN), cell,
                  Pose(float(low[0]), float(low[1]), 0.0), 0)


def free_places(raster: Raster, count: int) -> Array:
    """Return about `count` places (F, 2) [m], evenly taken from the free cells of a raster."""
    cells = np.flatnonzero(raster.values > 0)
    cells = cells[::max(1, len(cells) // count)]
    y, x = np.divmod(cells, raster.values.shape[1])
    return apply(raster.T_frame_raster, (np.column_stack([x, y]) + 0.5) * raster.resolution)


def nearest(points: Array, cell: float, margin: float) -> Raster:
    """Index of the nearest of points (N, 2) [m], at least one, up to `margin` [m] around them."""
    low = points.min(0) - margin
    width, height = np.ceil((points.max(0) + margin - low) / cell).astype(int) + 1
    x, y = ((points - low) / cell).astype(np.intp).T
    mark = np.ones((height, width), np.uint8)
    mark[y, x] = 0
    _, label = cv2.distanceTransformWithLabels(mark, cv2.DIST_L2, 5,
                                               labelType=cv2.DIST_LABEL_PIXEL)
    owner = np.zeros(label.max() + 1, np.int32)
    owner[label[y, x]] = np.arange(len(points))
    return Raster(owner[label], cell, Pose(low[0], low[1]), -1)


def _mark(walls: Array, grid: Grid, size: float, shape: tuple[int, int]) -> Array:
    """Zero where a wall lies, one elsewhere, on blocks of edge `size` [m]."""
    mark = np.ones(shape, np.uint8)
    x, y = (apply(inverse(grid.T_frame_grid), walls) / size).astype(np.intp).T
    mark[np.minimum(y, shape[0] - 1), np.minimum(x, shape[1] - 1)] = 0
    return mark
