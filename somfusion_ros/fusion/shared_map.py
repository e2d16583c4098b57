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
from somfusion_ros.grid import FREE, Grid

DRIVEN = -2           # value of a cell in which the robot's centre has been


class Cells(NamedTuple):
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
    def from_cells(cls, cells: Cells) -> 'SharedMap':
        """Read cells; ValueError, naming what is wrong, where they make no grid."""
        driven = cells.values == DRIVEN
        values = np.where(driven, FREE, cells.values) if driven.any() else cells.values
        grid = Grid.from_occupancy(values, cells.resolution, cells.T_frame_grid)
        return cls(grid, grid.points(driven))

    def to_cells(self) -> Cells:
        """Write cells, as they were read."""
        values = self.grid.to_occupancy()
        values[tuple(self.grid.point_to_cell(self.driven).T)] = DRIVEN
        return Cells(values, self.grid.resolution, self.grid.T_frame_grid)

    def same_as(self, other: 'SharedMap') -> bool:
        """Tell whether two maps hold the same."""
        one, two = self.grid, other.grid
        return (one.resolution == two.resolution and one.T_frame_grid == two.T_frame_grid
                and np.array_equal(one.evidence, two.evidence)
                and np.array_equal(self.driven, other.driven))


def mark_driven(cells: Cells, path: Iterable[Iterable[float]]) -> Cells:
    """Mark the cells that a path (N, 2) [m] in the map frame passes; bends are cut short."""
    points = np.asarray(list(path), dtype=float).reshape(-1, 2)
    if len(points):
        grid = Grid.from_occupancy(cells.values, cells.resolution, cells.T_frame_grid)
        at = grid.point_to_cell(_dense(points, cells.resolution))
        at = at[((at >= 0) & (at < grid.shape)).all(1)]
        values = cells.values.copy()
        values[tuple(at.T)] = DRIVEN
        cells = cells._replace(values=values)
    return cells


def _dense(points: Array, step: float) -> Array:
    """Points (M, 2) along a path (N, 2), at most a step [m] apart."""
    along = np.r_[0.0, np.hypot(*np.diff(points, axis=0).T).cumsum()]
    where = np.linspace(0.0, along[-1], int(along[-1] / step) + 2)
    return np.column_stack([np.interp(where, along, axis) for axis in points.T])
