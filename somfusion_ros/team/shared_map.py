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

FINEST, COARSEST = 0.001, 5.0   # [m] edge of a cell that a map can have
FARTHEST = 1e5                  # [m] between a map's origin and its frame's
LEAP = 1.0                      # [m] between two places of a path that is not driven straight
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
        """Read cells; ValueError, naming what is wrong, where they make no map of a robot."""
        check(cells)
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


def check(cells: Cells) -> None:
    """Raise ValueError, naming what is wrong, on a geometry that no robot's map has."""
    if not FINEST <= cells.resolution <= COARSEST:
        raise ValueError(f'resolution {cells.resolution:.3g} m is outside [{FINEST}, {COARSEST}]')
    if not max(abs(cells.T_frame_grid.x), abs(cells.T_frame_grid.y)) <= FARTHEST:
        raise ValueError(f'origin {tuple(cells.T_frame_grid)} is over {FARTHEST:.0f} m away')


def mark_driven(cells: Cells, path: Iterable[Iterable[float]]) -> Cells:
    """Mark the cells that a path (N, 2) [m] in the map frame passes; bends are cut short."""
    points = np.asarray(list(path), dtype=float).reshape(-1, 2)
    points = points[(np.abs(points) <= FARTHEST).all(1)]
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
    """Points (M, 2) along a path (N, 2), at most a step [m] apart; leaps stay empty."""
    gaps = np.diff(points, axis=0)
    length = np.hypot(*gaps.T)
    count = np.where(length <= LEAP, np.ceil(length / step), 1.0).astype(int)
    which = np.repeat(np.arange(len(gaps)), count)
    share = (np.arange(len(which)) - np.repeat(count.cumsum() - count, count)) / count[which]
    return np.concatenate([points[which] + share[:, None] * gaps[which], points[-1:]])
