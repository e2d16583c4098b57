# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the figures are drawn from, and maps as pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TYPE_CHECKING

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
AGREEMENT, AGREEMENT_PALE, CONFLICT, ONE = '#009E73', '#D5EFE6', '#D0021B', '#9AA3AB'
PIXELS = 300    # of a panel along a side; walls are drawn at least one wide
STRAY = 0.001   # share of wall cells that a figure may leave out

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
    _pictures: dict[str, Any] = field(default_factory=dict)

    def picture(self, name: str, make: Callable[[], 'Picture']) -> 'Picture':
        """Make a picture once; the page and the single figures show the same ones."""
        if name not in self._pictures:
            self._pictures[name] = make()
        return self._pictures[name]

    @property
    def pose(self) -> Pose | None:
        """T_target_source, the best found, accepted or not."""
        return self.trace.alignment.T_target_source


def bounds(grids: Sequence[Grid], poses: Sequence[Pose], margin: float = 1.0) -> Extent:
    """
    Left, right, bottom, top [m] of the walls of placed maps.

    One wall cell in a thousand may lie outside: far stray returns would shrink all the rest.
    """
    boxes = []
    for grid, pose in zip(grids, poses):
        points = apply(pose, grid.points(grid.occupied))
        if len(points):
            boxes.append(np.quantile(points, (STRAY, 1.0 - STRAY), axis=0))
    if not boxes:
        return (-1.0, 1.0, -1.0, 1.0)
    (left, bottom), (right, top) = np.min(boxes, (0, 1)) - margin, np.max(boxes, (0, 1)) + margin
    return float(left), float(right), float(bottom), float(top)


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


class Sampler:
    """Looks up masks of a placed map at the cells of a raster."""

    def __init__(self, grid: Grid, pose: Pose, centres: Array, shape: tuple[int, int]) -> None:
        """Find the map's cell under every raster centre (N, 2) [m]; T_world_map is the pose."""
        cells = grid.point_to_cell(apply(inverse(pose), centres))
        self._inside = ((cells >= 0) & (cells < grid.shape)).all(1)
        self._cells = tuple(cells[self._inside].T)
        self._shape = shape

    def __call__(self, mask: NDArray) -> NDArray:
        """Give the values of a mask (H, W) of the map on the raster; 0 outside."""
        values = np.zeros(len(self._inside), mask.dtype)
        values[self._inside] = mask[self._cells]
        return values.reshape(self._shape)


def map_picture(grid: Grid, colour: str = WALL) -> Picture:
    """Picture of one map in its own frame."""
    return overlay_picture([(grid, Pose(), colour)])


def overlay_picture(placed: Sequence[tuple[Grid, Pose, str]]) -> Picture:
    """Picture of several placed maps, each one's walls in its colour, shared walls dark."""
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


def agreement_picture(data: PairData, verdict: NDArray[np.int8]) -> Picture:
    """Picture of where source cells agree (1) or contradict (-1) the target's."""
    poses = (Pose(), data.pose)
    centres, shape, extent = raster(bounds(data.grids, poses),
                                    min(grid.resolution for grid in data.grids))
    samplers = [Sampler(grid, pose, centres, shape) for grid, pose in zip(data.grids, poses)]
    sampled = samplers[1](verdict)
    free, wall = (
        np.logical_or(*(sample(getattr(grid, kind)) for grid, sample in zip(data.grids, samplers)))
        for kind in ('free', 'occupied'))
    image = np.tile(np.array(to_rgb(UNKNOWN), np.float32), (*shape, 1))
    image[free] = to_rgb(FREE)
    image[free & (sampled > 0)] = to_rgb(AGREEMENT_PALE)
    wall = thick(wall)
    image[wall] = to_rgb(ONE)
    image[wall & (sampled > 0)] = to_rgb(AGREEMENT)
    image[thick(sampled < 0)] = to_rgb(CONFLICT)
    return image, extent


def thick(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Widen walls of a large picture, which would else fade on paper."""
    size = round(max(mask.shape) / PIXELS)
    if size <= 1:
        return mask
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def team_colours(names: Sequence[str]) -> Mapping[str, str]:
    """Give every robot its colour."""
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
