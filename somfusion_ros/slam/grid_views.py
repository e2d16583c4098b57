# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A drawn map as a checkpoint: views of a laser that looks all around, from places all over it.

So a robot is found and tracked in a map of another SLAM, or of another robot, as in its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, between, inverse
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.slam.tracking import Tracker


@dataclass(frozen=True)
class GridViewTuning:
    """From where a drawn map is looked at, and how."""

    apart: float = tuned(
        1.5, 'm', 'between two places from which the map is looked at', 'not measured')
    clearance: float = tuned(
        0.3, 'm', 'from such a place to the nearest wall or unknown cell', 'by design')
    reach: float = tuned(
        15.0, 'm', 'of the laser that looks; more costs time', 'not measured')
    thickness: int = tuned(
        5, 'cells', 'of a square within which the middle of a wall is taken', 'wean')
    certain: tuple[float, float, float] = tuned(
        (0.001, 0.001, 0.0005), 'm, m, rad', 'sigmas between two places: a drawn map is rigid',
        'by design')


TUNING = GridViewTuning()
BEAMS = 720        # of the laser that looks
LEAST = 20         # points that make a view


def grid_checkpoint(grid: Grid) -> Checkpoint:
    """
    Return a checkpoint with views all over a map, in the map's frame.

    ValueError where there is no free space with walls around it, or cells are too large.
    """
    if grid.resolution > TUNING.apart:
        raise ValueError(f'cells of {grid.resolution:g} m are too large to be found in')
    places = _places(grid)
    middles, blind = _middles(grid), _blind(grid)
    clouds = [_look(grid, middles, blind, place) for place in places]
    seen = [k for k, one in enumerate(clouds) if len(one) >= LEAST]
    if not seen:
        raise ValueError('the map has no free space that is large enough, with walls around it')
    order = _snake(places[seen], seen)
    poses = np.column_stack([places[order], np.zeros(len(order))])
    R = np.diag(TUNING.certain) ** 2
    # The filter takes its first view for the origin: a first one without a surface is put there.
    poses = np.concatenate([np.zeros((1, 3)), poses])
    views = [Cloud(np.zeros((0, 2)), np.zeros((0, 2))), *(clouds[k] for k in order)]
    constraints = [Constraint(k, k + 1, between(poses[k], poses[k + 1]), R)
                   for k in range(len(poses) - 1)]
    return Checkpoint(
        poses=poses, stamps=np.zeros(len(poses)), clouds=views, constraints=constraints, scans=(),
        trail=np.array([[0.0, 1.0, 0.0, 0.0, 0.0]]), to_close=(), view=1,
        tracker=Tracker(SlamConfig()).state())


def _places(grid: Grid) -> Array:
    """Return places (n, 2) [m] on a lattice over the free space of a map, clear of walls."""
    free = np.pad(grid.free.astype(np.uint8), 1)
    clear = cv2.distanceTransform(free, cv2.DIST_L2, 5)[1:-1, 1:-1] * grid.resolution
    edge = max(1, round(TUNING.apart / grid.resolution))
    found = []
    for row in range(0, grid.shape[0], edge):
        for column in range(0, grid.shape[1], edge):
            block = clear[row:row + edge, column:column + edge]
            y, x = np.unravel_index(int(block.argmax()), block.shape)
            if block[y, x] >= TUNING.clearance:
                found.append((column + x + 0.5, row + y + 0.5))
    cells = np.array(found, float).reshape(-1, 2)
    return apply(grid.T_frame_grid, cells * grid.resolution)


def _snake(places: Array, numbers: list[int]) -> NDArray[np.intp]:
    """Order numbered places (n, 2) so that each is near the one before it."""
    left, order = list(range(len(places))), [0]
    left.remove(0)
    while left:
        away = np.hypot(*(places[left] - places[order[-1]]).T)
        order.append(left.pop(int(away.argmin())))
    return np.array(numbers)[order]


def _middles(grid: Grid) -> Array:
    """
    Return the middle (H, W, 2) [m] of the wall around every cell, in the map's frame.

    Walls are drawn as thick as they blur; a beam that ends at their face is too short.
    """
    wall = grid.occupied.astype(np.float32)
    y, x = np.indices(grid.shape, dtype=np.float32)
    size = (TUNING.thickness, TUNING.thickness)
    parts = [cv2.boxFilter(image, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
             for image in (wall, wall * x, wall * y)]
    near = np.maximum(parts[0], 1.0)
    cells = np.stack([parts[1] / near, parts[2] / near], axis=-1) + 0.5
    middles = apply(grid.T_frame_grid, cells.reshape(-1, 2) * grid.resolution)
    return middles.reshape(*grid.shape, 2)


def _blind(grid: Grid) -> NDArray[np.bool_]:
    """Mask (H, W) of the unknown cells through which no beam passes: not those along walls."""
    size = np.ones((TUNING.thickness, TUNING.thickness), np.uint8)
    near = cv2.dilate(grid.occupied.astype(np.uint8), size) > 0
    blind: NDArray[np.bool_] = ~(grid.free | near)
    return blind


def _look(grid: Grid, middles: Array, blind_cells: NDArray[np.bool_], place: Array) -> Cloud:
    """
    Return what a laser sees all around at a place (2,) of a map, in the map's axes.

    middles (H, W, 2) [m] are those of the walls; beams end at walls and in blind cells (H, W).
    """
    step = 0.5 * grid.resolution
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    beams = np.column_stack([np.cos(angles), np.sin(angles)])
    away = np.arange(1, int(TUNING.reach / step)) * step
    points = place + beams[:, None] * away[:, None]                     # (BEAMS, K, 2)
    x, y = (apply(inverse(grid.T_frame_grid), points.reshape(-1, 2)) / grid.resolution).T
    x, y = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    height, width = grid.shape
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    wall = (inside & grid.occupied[y, x]).reshape(BEAMS, -1)
    blind = (~inside | blind_cells[y, x]).reshape(BEAMS, -1)
    stop = wall | blind
    first = stop.argmax(1)
    rows = np.arange(BEAMS)
    hit = wall[rows, first]
    cells = y.reshape(BEAMS, -1)[rows, first], x.reshape(BEAMS, -1)[rows, first]
    ranges = np.where(hit, ((middles[cells] - place) * beams).sum(1), np.nan)
    scan = Scan(0.0, ranges, -np.pi, 2.0 * np.pi / BEAMS, 0.01, TUNING.reach + 1.0)
    return cloud(scan, TUNING.reach)
