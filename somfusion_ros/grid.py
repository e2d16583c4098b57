# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Occupancy grids as evidence.

The whole core works on evidence C in [-1, 1]: negative is occupied, positive is free, and 0 is
unknown (the paper's map uncertainty, section II-B). Row 0 is the lowest y, as in
nav_msgs/OccupancyGrid; cell (row, column) covers [column, column + 1) x [row, row + 1) times the
resolution in the grid's own frame, which `T_frame_grid` places in the map frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from somfusion_ros.geometry import apply, Array, inverse, Pose

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
MAX_CELLS = 16384 * 16384
OCCUPIED_BELOW = -0.3   # the threshold at which Nav2 calls a cell a wall: p > 0.65
FREE_ABOVE = 0.6        # and free: p < 0.2


@dataclass(frozen=True, eq=False)
class Grid:
    """
    A map of one robot, or of several.

    Parameters
    ----------
    evidence : (H, W) array of float
        In [-1, 1]: negative for walls, 0 for unknown, positive for free; kept as float32.
    resolution : float
        Edge of a cell [m].
    T_frame_grid : Pose
        The corner of cell (0, 0) in the map frame.

    Raises
    ------
    ValueError
        In one line, on anything that is not a usable grid.

    Examples
    --------
    >>> grid = Grid(np.array([[1.0, -1.0], [0.0, 1.0]]), 0.05)
    >>> grid.to_occupancy().tolist()
    [[0, 100], [-1, 0]]
    """

    evidence: NDArray[np.float32]
    resolution: float
    T_frame_grid: Pose = field(default_factory=Pose)

    def __post_init__(self) -> None:
        _check(self.evidence, self.resolution, self.T_frame_grid)
        evidence = np.ascontiguousarray(self.evidence, dtype=np.float32)
        # Least and greatest are NaN where any is; masks of a large grid would cost memory.
        if not (evidence.min() >= -1.0 and evidence.max() <= 1.0):
            raise ValueError('evidence leaves [-1, 1] or is NaN')
        object.__setattr__(self, 'evidence', evidence)
        object.__setattr__(self, 'resolution', float(self.resolution))
        object.__setattr__(self, 'T_frame_grid', Pose.from_array(self.T_frame_grid))

    @classmethod
    def from_occupancy(cls, cells: ArrayLike, resolution: float,
                       origin: Sequence[float] = (0.0, 0.0, 0.0)) -> 'Grid':
        """
        Convert nav_msgs/OccupancyGrid cells.

        Parameters
        ----------
        cells : (H, W) array of int
            0..100 for the chance of a wall in percent, others unknown; row 0 is the lowest y.
        resolution : float
            Edge of a cell [m].
        origin : three floats
            (x [m], y [m], yaw [rad]) of the corner of cell (0, 0) in the map frame.

        Returns
        -------
        Grid
            The same map as evidence.

        Raises
        ------
        ValueError
            In one line, on anything that is not a usable grid.

        Examples
        --------
        >>> grid = Grid.from_occupancy([[0, 100], [-1, 50]], 0.05, (1.0, 2.0, 0.0))
        >>> grid.evidence.tolist()
        [[1.0, -1.0], [0.0, 0.0]]
        >>> grid.points(grid.occupied).round(3).tolist()
        [[1.075, 2.025]]
        """
        cells = np.asarray(cells)
        _check(cells, resolution, origin)
        unknown = OCCUPIED + 1
        table = np.append(1.0 - np.arange(unknown) / 50.0, 0.0).astype(np.float32)
        known = (cells >= FREE) & (cells <= OCCUPIED)
        index = np.where(known, cells, unknown).astype(np.uint8)
        return cls(table[index], resolution, Pose.from_array(origin))

    def to_occupancy(self) -> NDArray[np.int8]:
        """Return the cells (H, W) of nav_msgs/OccupancyGrid: -1 for unknown, else 0..100."""
        percent: NDArray[np.int8] = np.rint(50.0 * (1.0 - self.evidence)).astype(np.int8)
        percent[self.evidence == 0.0] = UNKNOWN
        return percent

    def to_trinary(self) -> NDArray[np.int8]:
        """Return cells (H, W) as slam_toolbox has them: 100 wall, 0 free, -1 neither for sure."""
        cells = np.full(self.shape, UNKNOWN, np.int8)
        cells[self.free] = FREE
        cells[self.occupied] = OCCUPIED
        return cells

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows (along y) and of columns (along x)."""
        rows, columns = self.evidence.shape
        return rows, columns

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Mask (H, W) of wall cells."""
        return self.evidence < OCCUPIED_BELOW

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask (H, W) of free cells."""
        return self.evidence > FREE_ABOVE

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (H, W) of cells about which anything is known."""
        known: NDArray[np.bool_] = self.evidence != 0.0
        return known

    def points(self, mask: NDArray[np.bool_]) -> Array:
        """Return the centres (N, 2) [m] in the map frame of a mask's (H, W) cells, row by row."""
        rows, columns = np.nonzero(mask)
        return self.cell_to_point(np.column_stack([rows, columns]))

    def cell_to_point(self, cells: ArrayLike) -> Array:
        """Return the centres (N, 2) [m] in the map frame of cells (N, 2), (row, column)."""
        cells = np.asarray(cells, dtype=float).reshape(-1, 2)
        return apply(self.T_frame_grid, (cells[:, ::-1] + 0.5) * self.resolution)

    def point_to_cell(self, points: ArrayLike) -> NDArray[np.intp]:
        """Return the cells (N, 2), (row, column), of map points (N, 2) [m]; may lie outside."""
        local = apply(inverse(self.T_frame_grid), np.asarray(points, dtype=float).reshape(-1, 2))
        cells: NDArray[np.intp] = np.floor(local / self.resolution).astype(np.intp)[:, ::-1]
        return cells


def _check(cells: ArrayLike, resolution: float, origin: Sequence[float]) -> None:
    """Raise ValueError, naming what is wrong, unless the parts make a grid."""
    shape = np.shape(cells)
    if len(shape) != 2 or 0 in shape:
        raise ValueError(f'grid must have two sides of at least one cell, got {shape}')
    if shape[0] * shape[1] > MAX_CELLS:
        raise ValueError(f'grid of {shape[1]} x {shape[0]} cells is over {MAX_CELLS} cells')
    if not np.isfinite(resolution) or resolution <= 0:
        raise ValueError(f'resolution must be positive and finite, got {resolution}')
    if np.shape(origin) != (3,) or not np.isfinite(origin).all():
        raise ValueError(f'origin must be three finite numbers, got {np.ravel(origin).tolist()}')
