# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the figures are drawn from, and maps as pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
from matplotlib.colors import to_rgb
import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import apply, Array, inverse, Pose
from somfusion_ros.grid import Grid

if TYPE_CHECKING:
    from somfusion_ros.fusion.alignment import Trace

# Okabe and Ito's colours, which colour-blind readers tell apart, too.
COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9')
BOTH, FREE, UNKNOWN, WALL = '#222222', '#EEF1F4', '#FFFFFF', '#222222'
AGREEMENT, CONFLICT = '#009E73', '#D0021B'
FINEST = 900   # cells along a side beyond which walls are drawn a cell wider

Extent = tuple[float, float, float, float]
Picture = tuple[NDArray[np.float64], Extent]


@dataclass(frozen=True, eq=False)
class PairData:
    """
    One pair of maps with its trace, and each robot's trajectory (N, 3) in its own map.

    The trajectories are empty where maps were merged that have none.
    """

    target: str
    source: str
    grids: tuple[Grid, Grid]
    trace: 'Trace'
    paths: tuple[Array, Array]

    @property
    def pose(self) -> Pose | None:
        """T_target_source, the best found, accepted or not."""
        return self.trace.alignment.T_target_source


def bounds(grids: Sequence[Grid], poses: Sequence[Pose], margin: float = 0.5) -> Extent:
    """Left, right, bottom, top [m] of the known cells of placed maps."""
    outlines = [(pose, _known_outline(grid)) for grid, pose in zip(grids, poses)]
    points = [apply(pose, outline) for pose, outline in outlines if len(outline)]
    if not points:
        return (-1.0, 1.0, -1.0, 1.0)
    every = np.concatenate(points)
    (left, bottom), (right, top) = every.min(0) - margin, every.max(0) + margin
    return float(left), float(right), float(bottom), float(top)


def _known_outline(grid: Grid) -> Array:
    """Outermost known cells (N, 2) [m] of every row: enough for bounds however it is turned."""
    known = grid.known
    rows = np.flatnonzero(known.any(1))
    first = known[rows].argmax(1)
    last = known.shape[1] - 1 - known[rows, ::-1].argmax(1)
    return grid.cell_to_point(np.column_stack([np.tile(rows, 2), np.concatenate([first, last])]))


def raster(extent: Extent, resolution: float) -> tuple[Array, tuple[int, int], Extent]:
    """Cell centres (H * W, 2) [m] of a raster over an extent, its shape, its exact extent."""
    left, right, bottom, top = extent
    width = max(int(np.ceil((right - left) / resolution)), 1)
    height = max(int(np.ceil((top - bottom) / resolution)), 1)
    x = left + (np.arange(width) + 0.5) * resolution
    y = bottom + (np.arange(height) + 0.5) * resolution
    centres = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return centres, (height, width), (left, left + width * resolution,
                                      bottom, bottom + height * resolution)


def look_up(grid: Grid, pose: Pose, centres: Array, mask: NDArray) -> NDArray:
    """Values (N,) of a mask (H, W) of a placed map at points (N, 2); 0 outside."""
    cells = grid.point_to_cell(apply(inverse(pose), centres))
    inside = ((cells >= 0) & (cells < grid.shape)).all(1)
    values = np.zeros(len(centres), mask.dtype)
    values[inside] = mask[tuple(cells[inside].T)]
    return values


def map_picture(grid: Grid, colour: str = WALL) -> Picture:
    """Picture of one map in its own frame."""
    return overlay_picture([(grid, Pose(), colour)])


def overlay_picture(placed: Sequence[tuple[Grid, Pose, str]]) -> Picture:
    """Picture of several placed maps, each one's walls in its colour, shared walls dark."""
    grids, poses = [item[0] for item in placed], [item[1] for item in placed]
    extent = bounds(grids, poses)
    resolution = min(grid.resolution for grid in grids)
    centres, shape, extent = raster(extent, resolution)
    image = np.tile(np.array(to_rgb(UNKNOWN)), (*shape, 1))
    counts = np.zeros(shape, int)
    for grid, pose, _ in placed:
        image[look_up(grid, pose, centres, grid.free).reshape(shape)] = to_rgb(FREE)
    for grid, pose, colour in placed:
        wall = thick(look_up(grid, pose, centres, grid.occupied).reshape(shape))
        image[wall] = to_rgb(colour)
        counts += wall
    image[counts > 1] = to_rgb(BOTH)
    return image, extent


def agreement_picture(data: PairData, verdict: NDArray[np.int8]) -> Picture:
    """Picture of where source cells agree (1) or contradict (-1) the target's."""
    target, source = data.grids
    extent = bounds(data.grids, [Pose(), data.pose])
    centres, shape, extent = raster(extent, min(target.resolution, source.resolution))
    image = np.tile(np.array(to_rgb(UNKNOWN)), (*shape, 1))
    sampled = look_up(source, data.pose, centres, verdict).reshape(shape)
    walls = [thick(look_up(grid, pose, centres, grid.occupied).reshape(shape))
             for grid, pose in zip(data.grids, (Pose(), data.pose))]
    for grid, pose in zip(data.grids, (Pose(), data.pose)):
        image[look_up(grid, pose, centres, grid.free).reshape(shape)] = to_rgb(FREE)
    image[sampled > 0] = to_rgb('#D5EFE6')
    image[walls[0] | walls[1]] = to_rgb('#9AA3AB')
    image[(walls[0] | walls[1]) & (sampled > 0)] = to_rgb(AGREEMENT)
    image[thick(sampled < 0)] = to_rgb(CONFLICT)
    return image, extent


def thick(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Widen walls of a large picture, which would else vanish on paper."""
    if max(mask.shape) <= FINEST // 2:
        return mask
    size = 2 if max(mask.shape) <= FINEST else 3
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def team_colours(names: Sequence[str]) -> Mapping[str, str]:
    """Give every robot its colour."""
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
