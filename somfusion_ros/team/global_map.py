# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One map of the world out of every robot's map.

Evidence is summed, never maximised: what one robot saw free and another occupied cancels. The
world's origin always lies on a cell corner, so a map that grows moves by whole cells only. Where a
robot has driven there is no wall: what others saw there was the robot.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, compose, Pose
from somfusion_ros.grid import FREE_ABOVE, Grid, MAX_CELLS, OCCUPIED_BELOW
from somfusion_ros.settings import tuned

MAX_SIDE = 32766     # OpenCV holds image coordinates in 16 bits


@dataclass(frozen=True)
class DrawingTuning:
    """What is exact enough."""

    aligned: float = tuned(
        1e-6, 'cells', 'corners nearer than this to a cell line lie on it; far above what doubles '
        'lose, far below a cell', 'by design')


TUNING = DrawingTuning()


def merge_grids(grids: Mapping[str, Grid], poses: Mapping[str, Pose],
                resolution: float | None = None, driven: Mapping[str, Array] | None = None,
                robot_radius: float = 0.0, own: str = '', most_cells: int = MAX_CELLS) -> Grid:
    """
    Sum the evidence of several maps in the world frame.

    Parameters
    ----------
    grids : mapping of str to Grid
        Map by robot, of any size, origin (yaw too) and resolution.
    poses : mapping of str to Pose
        T_world_map by robot; only robots in both mappings are drawn.
    resolution : float, optional
        Edge of a world cell [m], by default the finest of the maps'.
    driven : mapping of str to (N, 2) array, optional
        Points [m] of a robot's map frame in which its centre has been, by robot.
    robot_radius : float
        Within this distance [m] of them, what a robot's own map calls free is free.
    own : str
        The robot that draws: nobody frees what it sees as a wall, unless that is no larger than
        a robot.
    most_cells : int
        Of the result.

    Returns
    -------
    Grid
        The map of the world, on cells whose corners are multiples of the resolution: the same
        place has the same cells however the maps grow.

    Raises
    ------
    ValueError
        If no robot is in both mappings, or the maps lie too far apart for one grid; before it is
        made.

    Examples
    --------
    >>> wall = Grid(np.array([[-1.0, 1.0]]), 1.0)
    >>> merge_grids({'a': wall, 'b': wall}, {'a': Pose(), 'b': Pose(2.0)}).to_occupancy()
    array([[100,   0, 100,   0]], dtype=int8)
    """
    names = sorted(set(grids) & set(poses))
    if not names:
        raise ValueError('no robot has both a map and a pose in the world')
    if resolution is None:
        resolution = min(grids[name].resolution for name in names)
    parts = {name: part for name in names if (part := _known_part(grids[name])) is not None}
    if not parts:
        return Grid(np.zeros((1, 1), np.float32), resolution)
    bodies = Bodies(driven or {}, robot_radius, own)
    return _sum(parts, poses, resolution, bodies, min(most_cells, MAX_CELLS))


class Bodies(NamedTuple):
    """Where robots have driven [m] in their own maps, their radius [m], and the one that draws."""

    driven: Mapping[str, Array]
    radius: float
    own: str


def _sum(parts: Mapping[str, Grid], poses: Mapping[str, Pose], resolution: float,
         bodies: Bodies, most_cells: int) -> Grid:
    """Sum the evidence of the known parts of maps, and free where robots have driven."""
    boxes = [_bounds(part, poses[name], resolution) for name, part in parts.items()]
    low, high = np.min([box[0] for box in boxes], 0), np.max([box[1] for box in boxes], 0)
    _check_size(high - low, most_cells)
    total = np.zeros((high - low)[::-1], np.float32)
    free, kept = np.zeros(total.shape, bool), np.zeros(total.shape, bool)
    for (name, part), (first, last) in zip(parts.items(), boxes):
        window = tuple(slice(a, b) for a, b in zip((first - low)[::-1], (last - low)[::-1]))
        evidence = _resample(part, poses[name], resolution, first, last)
        total[window] += evidence
        if name == bodies.own:
            kept[window] = _larger_than(2.0 * bodies.radius / resolution + 2.0, evidence)
        if len(bodies.driven.get(name, ())):
            been = apply(poses[name], bodies.driven[name]) / resolution - first
            free[window] |= _discs(been, bodies.radius / resolution, evidence.shape) & (
                evidence > FREE_ABOVE)
    free &= ~kept
    total[free] = np.maximum(total[free], 1.0)
    x, y = low * resolution
    return Grid(np.clip(total, -1.0, 1.0), resolution, Pose(x, y, 0.0))


def _discs(points: Array, radius: float, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of the cells within a radius of points (N, 2) as (column, row), all in cells."""
    mask = np.zeros(shape, np.uint8)
    for column, row in np.unique(np.floor(points).astype(int), axis=0).tolist():
        cv2.circle(mask, (column, row), int(np.ceil(radius)), 1, cv2.FILLED)
    return mask.astype(bool)


def _larger_than(size: float, evidence: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Mask of the walls that reach over more cells than a size in one direction."""
    walls = (evidence < OCCUPIED_BELOW).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls, connectivity=8)
    large = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(1) > size
    large[0] = False
    return np.asarray(large[labels], bool)


def _known_part(grid: Grid) -> Grid | None:
    """Cut a map to its known cells; None where there are none."""
    rows, columns = np.flatnonzero(grid.known.any(1)), np.flatnonzero(grid.known.any(0))
    if not len(rows):
        return None
    corner = Pose(columns[0] * grid.resolution, rows[0] * grid.resolution, 0.0)
    return Grid(grid.evidence[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1], grid.resolution,
                Pose.from_array(compose(grid.T_frame_grid, corner)))


def _bounds(grid: Grid, T_world_map: Pose, resolution: float) -> tuple[Array, Array]:
    """Return first and one-past-last world cell (column, row) that a map reaches."""
    height, width = np.array(grid.shape) * grid.resolution
    corners = np.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)])
    cells = apply(compose(T_world_map, grid.T_frame_grid), corners) / resolution
    if not np.abs(cells).max() < 2 ** 31:
        x, y = compose(T_world_map, grid.T_frame_grid)[:2]
        raise ValueError(f'a map lies too far from the world origin: at {x:g}, {y:g} m')
    low, high = np.floor(cells.min(0) + TUNING.aligned), np.ceil(cells.max(0) - TUNING.aligned)
    return low.astype(int), np.maximum(high, low + 1).astype(int)


def _check_size(size: Array, most_cells: int) -> None:
    """Raise ValueError where the world's map would not fit in memory, or have too many cells."""
    if max(size) > MAX_SIDE or int(size[0]) * int(size[1]) > most_cells:
        raise ValueError(f'a global map of {size[0]} x {size[1]} cells is too large')


def _resample(grid: Grid, T_world_map: Pose, resolution: float, first: Array,
              last: Array) -> NDArray[np.float32]:
    """
    Look up a map's evidence at the centres of world cells first..last - 1 (column, row).

    Cells coarser than the map's are sampled several times: a wall among the samples wins, so
    that thin walls survive, else their mean counts.
    """
    samples = max(1, int(np.ceil(resolution / grid.resolution - TUNING.aligned)))
    fine = resolution / samples
    x, y, theta = compose(T_world_map, grid.T_frame_grid)
    # Cell centres: world = R (source + 1/2) g + t, and image pixel = (world / fine) - 1/2 - first.
    c, s = np.cos(theta) * grid.resolution / fine, np.sin(theta) * grid.resolution / fine
    matrix = np.array([[c, -s, x / fine - first[0] * samples - 0.5 + 0.5 * (c - s)],
                       [s, c, y / fine - first[1] * samples - 0.5 + 0.5 * (s + c)]])
    width, height = (last - first) * samples
    if max(width, height, *grid.shape) > MAX_SIDE:
        raise ValueError(f'a map of {width} x {height} cells is too large to resample')
    image = np.asarray(cv2.warpAffine(
        grid.evidence, matrix, (int(width), int(height)), flags=cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT, borderValue=0), np.float32)
    if samples == 1:
        return image
    blocks = image.reshape(height // samples, samples, width // samples, samples)
    lowest, mean = blocks.min((1, 3)), blocks.mean((1, 3))
    return np.asarray(np.where(lowest < OCCUPIED_BELOW, lowest, mean), np.float32)
