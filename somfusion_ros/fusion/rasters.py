# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rasters of a map: its zones, likelihood field and nearest features, for any point at once."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.geometry import apply, Array, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned

ROUNDING = 1e-6     # cells by which a distance may be off
CLEARANCE_STEP = 0.05    # of the values of `clearance` [m]
NEAR, FREE, WALL = np.uint8(1), np.uint8(2), np.uint8(4)     # flags of zones
WIDEST = 32767      # OpenCV looks up fewer places in a row, in rasters with fewer cells in a row


@dataclass(frozen=True)
class RasterSettings:
    """Numbers that the rasters were tuned with."""

    free_from: float = tuned(
        0.5, 'evidence',
        'mean from which a block of cells counts as free',
        'by design')
    brighten: float = tuned(
        2.5, '',
        'brings a straight wall of one cell back to full height after the blur',
        'by design')
    tolerance: float = tuned(
        0.2, 'm',
        'a wall within this distance of another is the same: what drift leaves',
        'benchmarks/fusion/calibration.py')
    dense: int = tuned(
        3, 'times',
        'that cells are drawn from which `nearest` is faster than `nearby`',
        'benchmarks/fusion/growth.py')


RASTERS = RasterSettings()


@dataclass(frozen=True, eq=False)
class Raster:
    """
    Values (H, W) on cells of `resolution` [m] with the corner at T_frame_raster.

    Every point beyond has the value `outside`.
    """

    values: Array
    resolution: float
    T_frame_raster: Pose
    outside: float

    def at(self, points: NDArray[np.float32]) -> Array:
        """Return the values (...) at points (2, ...) [m] of the map frame."""
        c, s, across, up = self._to_cells
        x, y = points
        column, row = (x * c, y * c) if s == 0.0 else (x * c - y * s, x * s + y * c)
        column, row = column + across, row + up
        if column.size and max(self.values.shape + column.shape) < WIDEST:
            found = cv2.remap(self.values, column, row, cv2.INTER_NEAREST,
                              borderMode=cv2.BORDER_CONSTANT, borderValue=self.outside)
            return found.reshape(column.shape)
        height, width = self.values.shape
        column, row = np.rint(column).astype(np.intp), np.rint(row).astype(np.intp)
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        found = self.values.ravel()[np.where(inside, row * width + column, 0)]
        return np.where(inside, found, self.values.dtype.type(self.outside))

    @cached_property
    def _to_cells(self) -> NDArray[np.float32]:
        """Cosine, sine and shift that take map points to cells, whose centres are whole."""
        x, y, theta = inverse(self.T_frame_raster)
        scaled = np.array([np.cos(theta), np.sin(theta), x, y]) / self.resolution
        return (scaled - [0.0, 0.0, 0.5, 0.5]).astype(np.float32)


def zones(grid: Grid, walls: Index, cell: float) -> Raster:
    """
    Return the raster of flags: NEAR a wall or a WALL itself, known to be FREE and no wall.

    Parameters
    ----------
    walls : (N, 2) wall cells (row, column) of the grid
    cell : wanted edge of the raster's cells [m]; a whole multiple of the grid's is taken
    """
    factor = max(1, round(cell / grid.resolution))
    height, width = (max(1, side // factor) for side in grid.shape)
    block = grid.evidence[:height * factor, :width * factor]
    if min(block.shape) < factor:
        block = grid.evidence
    mean = cv2.resize(block, (width, height), interpolation=cv2.INTER_AREA)
    flags = (mean > RASTERS.free_from).view(np.uint8) * FREE
    row, column = np.minimum(walls // factor, (height - 1, width - 1)).T
    flags[row, column] = WALL
    size = grid.resolution * factor
    around = cv2.dilate(flags & WALL, _disc(RASTERS.tolerance / size))
    near = np.asarray(around // WALL * NEAR, np.uint8)
    return Raster(flags | near, size, grid.T_frame_grid, 0)


def clearance(zones_of_map: Raster) -> Raster:
    """Draw how far the nearest place is that is not known to be free, in CLEARANCE_STEP [m]."""
    free = zones_of_map.values & FREE
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 3)
    steps = np.minimum(distance * (zones_of_map.resolution / CLEARANCE_STEP), 255.0)
    return Raster(steps.astype(np.uint8), zones_of_map.resolution, zones_of_map.T_frame_raster, 0)


def likelihood(points: Array, cell: float) -> Raster:
    """
    Return likelihoods: 255 on a wall of points (N, 2) [m], falling within two cells.

    A speck counts for less than a wall. Cells of edge `cell` [m] and a blur of one cell.
    """
    low = points.min(0) - 4.5 * cell     # so that cells of this size fall into the middle
    width, height = np.ceil((points.max(0) - low) / cell).astype(int) + 5
    x, y = ((points - low) / cell).astype(np.intp).T
    image = np.zeros((height, width), np.uint8)
    image[y, x] = 255
    cv2.GaussianBlur(image, (5, 5), 1.0, dst=image)
    cv2.convertScaleAbs(image, dst=image, alpha=RASTERS.brighten)
    return Raster(image, cell, Pose(float(low[0]), float(low[1]), 0.0), 0)


def free_places(raster: Raster, count: int) -> Array:
    """Return about `count` places (F, 2) [m], evenly taken from the free cells of zones."""
    cells = np.flatnonzero((raster.values & FREE) == FREE)
    cells = cells[::max(1, len(cells) // count)]
    y, x = np.divmod(cells, raster.values.shape[1])
    return apply(raster.T_frame_raster, (np.column_stack([x, y]) + 0.5) * raster.resolution)


def nearest(points: Array, cell: float, margin: float) -> Raster:
    """Index the nearest of points (N, 2) [m], at least one, up to `margin` [m] around them."""
    low = points.min(0) - margin
    width, height = np.ceil((points.max(0) + margin - low) / cell).astype(int) + 1
    x, y = ((points - low) / cell).astype(np.intp).T
    mark = np.ones((height, width), np.uint8)
    mark[y, x] = 0
    _, label = cv2.distanceTransformWithLabels(mark, cv2.DIST_L2, 5,
                                               labelType=cv2.DIST_LABEL_PIXEL)
    owner = np.zeros(label.max() + 1, np.float32)     # floats, which OpenCV can look up
    owner[label[y, x]] = np.arange(len(points))
    return Raster(owner[label], cell, Pose(low[0], low[1]), -1)


def nearby(points: Array, cell: float, reach: float) -> Raster:
    """
    Index the nearest of points (N, 2) [m], at least one, of those up to `reach` [m] away.

    Every point is drawn with its surroundings, the furthest of all first: much faster than
    `nearest`, which knows no reach, unless the points lie dense.
    """
    low = points.min(0) - reach
    width, height = np.ceil((points.max(0) + reach - low) / cell).astype(int) + 1
    x, y = ((points - low) / cell).astype(np.intp).T
    row, column = np.nonzero(_disc(reach / cell))
    if len(points) * len(row) > RASTERS.dense * width * height:
        return nearest(points, cell, reach)
    owner = np.full((height, width), -1, np.float32)     # floats, which OpenCV can look up
    middle = row.max() // 2
    order = np.argsort(-np.hypot(row - middle, column - middle), kind='stable')
    offset = (row - middle) * width + column - middle
    owner.ravel()[offset[order, None] + y * width + x] = np.arange(len(points))
    return Raster(owner, cell, Pose(low[0], low[1]), -1)


def _disc(radius: float) -> NDArray[np.uint8]:
    """Return the disc of a radius [cells], as a mask."""
    reach = np.arange(-int(radius + ROUNDING), int(radius + ROUNDING) + 1)
    return (np.hypot(reach[:, None], reach) <= radius + ROUNDING).astype(np.uint8)
