# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A robot's map as the team shares it: the grid, and where the robot itself has driven.

On the wire both are one array of cells: those of nav_msgs/OccupancyGrid, and a value of its own
for a cell in which the robot's centre has been.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import FREE, Grid, UNKNOWN
from somfusion_ros.settings import tuned

WALL = 65                       # occupancy from which a cell is a wall
FEW_WALLS = 10000               # cells; a smaller map may be all walls, it costs nothing
MOST_WALLS = 1 << 20            # cells of wall; what is learned of them takes 0.7 kB each
DRIVEN = -2                     # value of a cell in which the robot's centre has been


@dataclass(frozen=True)
class SharedMapTuning:
    """What a robot's map can be, and how a path becomes driven cells."""

    finest: float = tuned(0.001, 'm', 'edge of the smallest cell of any map', 'by design')
    coarsest: float = tuned(5.0, 'm', 'edge of the largest cell of any map', 'by design')
    farthest: float = tuned(
        1e5, 'm', "anything farther from its frame's origin is no place of a robot", 'by design')
    most_walls_share: float = tuned(
        0.5, '', 'a map of which more is wall than this, of the known cells, is none: real ones '
        'have 0.03, and at most 0.14', 'the shared pairs')
    leap: float = tuned(
        1.0, 'm', 'two places of a path that are farther apart were not joined by driving '
        'straight', 'not measured')


TUNING = SharedMapTuning()


class MapCells(NamedTuple):
    """Cells (H, W) int8 of a map, their edge [m], and the pose of the corner of cell (0, 0)."""

    values: NDArray[np.int8]
    resolution: float
    T_frame_grid: Pose


@dataclass(frozen=True, eq=False)
class SharedMap:
    """A robot's grid and points (N, 2) [m] of its map frame in which its centre has been."""

    grid: Grid
    driven: Array = field(default_factory=lambda: np.empty((0, 2)))

    @classmethod
    def from_cells(cls, cells: MapCells) -> 'SharedMap':
        """Read cells; ValueError, naming what is wrong, where they make no map of a robot."""
        check(cells)
        driven = cells.values == DRIVEN
        values = np.where(driven, FREE, cells.values) if driven.any() else cells.values
        grid = Grid.from_occupancy(values, cells.resolution, cells.T_frame_grid)
        return cls(grid, grid.points(driven))

    @classmethod
    def showing(cls, cells: MapCells) -> 'SharedMap':
        """Read cells; ValueError also where they show nothing."""
        shared = cls.from_cells(cells)
        if not shared.grid.known.any():
            raise ValueError('grid is all unknown')
        return shared

    def to_cells(self) -> MapCells:
        """Write cells, as they were read."""
        values = self.grid.to_occupancy()
        values[tuple(self.grid.point_to_cell(self.driven).T)] = DRIVEN
        return MapCells(values, self.grid.resolution, self.grid.T_frame_grid)

    def same_as(self, other: 'SharedMap') -> bool:
        """Return whether two maps hold the same."""
        one, two = self.grid, other.grid
        return (one.resolution == two.resolution and one.T_frame_grid == two.T_frame_grid
                and np.array_equal(one.evidence, two.evidence)
                and np.array_equal(self.driven, other.driven))


def check(cells: MapCells) -> None:
    """Raise ValueError, naming what is wrong, on a geometry that no robot's map has."""
    walls = np.count_nonzero(cells.values >= WALL)
    if walls > MOST_WALLS or (walls > FEW_WALLS and walls > TUNING.most_walls_share
                              * np.count_nonzero(cells.values != UNKNOWN)):
        raise ValueError(f'{walls} cells of wall are too many for a map of this size')
    low, high, far = TUNING.finest, TUNING.coarsest, TUNING.farthest
    if not low <= cells.resolution <= high:
        raise ValueError(f'resolution {cells.resolution:.3g} m is outside [{low}, {high}]')
    if not max(abs(cells.T_frame_grid.x), abs(cells.T_frame_grid.y)) <= far:
        raise ValueError(f'origin {tuple(cells.T_frame_grid)} is over {far:.0f} m away')


def mark_driven(cells: MapCells, path: Iterable[Iterable[float]]) -> MapCells:
    """Mark the cells that a path (N, 2) [m] in the map frame passes; bends are cut short."""
    points = np.asarray(list(path), dtype=float).reshape(-1, 2)
    points = points[(np.abs(points) <= TUNING.farthest).all(1)]
    if len(points):
        check(cells)
        grid = Grid.from_occupancy(cells.values, cells.resolution, cells.T_frame_grid)
        at = grid.point_to_cell(_dense(points, cells.resolution))
        at = at[((at >= 0) & (at < grid.shape)).all(1)]
        values = cells.values.copy()
        values[tuple(at.T)] = DRIVEN
        cells = cells._replace(values=values)
    return cells


def _dense(points: Array, step: float) -> Array:
    """Return points (M, 2) along a path (N, 2), at most a step [m] apart; leaps stay empty."""
    gaps = np.diff(points, axis=0)
    length = np.hypot(*gaps.T)
    count = np.where(length <= TUNING.leap, np.ceil(length / step), 1.0).astype(int)
    which = np.repeat(np.arange(len(gaps)), count)
    share = (np.arange(len(which)) - np.repeat(count.cumsum() - count, count)) / count[which]
    return np.concatenate([points[which] + share[:, None] * gaps[which], points[-1:]])
