# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Placed maps as pictures: the walls in colours, and where two maps agree."""

from collections.abc import Sequence
import io
from pathlib import Path
from typing import Any

import cv2
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.report.palette import (AGREEMENT, AGREEMENT_PALE, BOTH, CONFLICT, FREE, ONE,
                                          UNKNOWN, WALL)
from somfusion_ros.whole_files import write_files

PIXELS = 300    # of a panel along a side; walls are drawn at least one wide
STRAY = 0.001   # share of wall cells that a figure may leave out

Extent = tuple[float, float, float, float]   # left, right, bottom, top [m]
Picture = tuple[Array, Extent]               # image (H, W, 3) in [0, 1], row 0 at the bottom


def write_figure(path: Path, figure: Figure, **options: Any) -> None:
    """Write a figure as PNG, with further options of savefig; OSError leaves what was there."""
    image = io.BytesIO()
    figure.savefig(image, format='png', **options)
    write_files({path: image.getvalue()})


def bounds(grids: Sequence[Grid], poses: Sequence[Pose], margin: float = 1.0) -> Extent:
    """
    Return the extent of the walls of placed maps.

    One wall cell in a thousand may lie outside: far stray returns would shrink all the rest.
    """
    boxes: list[Array] = []
    for grid, pose in zip(grids, poses):
        points = apply(pose, grid.points(grid.occupied))
        if len(points):
            boxes.append(np.quantile(points, (STRAY, 1.0 - STRAY), axis=0))
    if not boxes:
        return (-1.0, 1.0, -1.0, 1.0)
    ends = np.concatenate(boxes)
    (left, bottom), (right, top) = ends.min(0) - margin, ends.max(0) + margin
    return float(left), float(right), float(bottom), float(top)


def raster(extent: Extent, resolution: float) -> tuple[Array, tuple[int, int], Extent]:
    """Return the cell centres (H * W, 2) [m] of a raster, its shape and its exact extent."""
    left, right, bottom, top = extent
    width = max(int(np.ceil((right - left) / resolution)), 1)
    height = max(int(np.ceil((top - bottom) / resolution)), 1)
    x = left + (np.arange(width) + 0.5) * resolution
    y = bottom + (np.arange(height) + 0.5) * resolution
    centres = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return centres, (height, width), (left, left + width * resolution,
                                      bottom, bottom + height * resolution)


class Sampler:
    """Masks of a placed map, looked up at the cells of a raster."""

    def __init__(self, grid: Grid, pose: Pose, centres: Array, shape: tuple[int, int]) -> None:
        """Find the map's cell under every raster centre (N, 2) [m]; `pose` is T_raster_map."""
        cells = grid.point_to_cell(apply(inverse(pose), centres))
        (row, column), (height, width) = cells.T, grid.shape
        self._inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        self._cells = tuple(cells[self._inside].T)
        self._shape = shape

    def __call__(self, mask: Array) -> Array:
        """Return the values of an array (H, W) of the map on the raster; 0 outside."""
        values = np.zeros(len(self._inside), mask.dtype)
        values[self._inside] = mask[self._cells]
        return values.reshape(self._shape)


def map_picture(grid: Grid, colour: str = WALL) -> Picture:
    """Draw one map in its own frame."""
    return overlay_picture([(grid, Pose(), colour)])


def overlay_picture(placed: Sequence[tuple[Grid, Pose, str]]) -> Picture:
    """Draw several placed maps, each one's walls in its colour, shared walls dark."""
    grids, poses = [item[0] for item in placed], [item[1] for item in placed]
    extent = bounds(grids, poses)
    resolution = min(grid.resolution for grid in grids)
    centres, shape, extent = raster(extent, resolution)
    image = np.tile(np.array(to_rgb(UNKNOWN), np.float32), (*shape, 1))
    samplers = [Sampler(grid, pose, centres, shape) for grid, pose, _ in placed]
    for grid, sample in zip(grids, samplers):
        image[sample(grid.free)] = to_rgb(FREE)
    counts = np.zeros(shape, int)
    for (grid, _, colour), sample in zip(placed, samplers):
        wall = thick(sample(grid.occupied))
        image[wall] = to_rgb(colour)
        counts += wall
    image[counts > 1] = to_rgb(BOTH)
    return image, extent


def agreement_picture(target: Grid, source: Grid, T_target_source: Pose,
                      verdict: NDArray[np.int8]) -> Picture:
    """Draw where the source's cells agree (1) with the target's or contradict them (-1)."""
    grids, poses = (target, source), (Pose(), T_target_source)
    centres, shape, extent = raster(bounds(grids, poses), min(grid.resolution for grid in grids))
    of_target, of_source = (Sampler(grid, pose, centres, shape)
                            for grid, pose in zip(grids, poses))
    sampled = of_source(verdict)
    free = of_target(target.free) | of_source(source.free)
    wall = of_target(target.occupied) | of_source(source.occupied)
    image = np.tile(np.array(to_rgb(UNKNOWN), np.float32), (*shape, 1))
    image[free] = to_rgb(FREE)
    image[free & (sampled > 0)] = to_rgb(AGREEMENT_PALE)
    wall = thick(wall)
    image[wall] = to_rgb(ONE)
    image[wall & (sampled > 0)] = to_rgb(AGREEMENT)
    image[thick(sampled < 0)] = to_rgb(CONFLICT)
    return image, extent


def thick(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Widen the walls of a large picture, which would otherwise fade when it is shrunk."""
    size = round(max(mask.shape) / PIXELS)
    if size <= 1:
        return mask
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
