# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How well the walls of two maps in one frame agree, whatever the truth may be."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class AgreementTuning:
    """When walls agree."""

    near: float = tuned(0.10, 'm', 'between walls that are the same wall', 'by design')


TUNING = AgreementTuning()
FEWEST = 20      # wall cells that say anything


def wall_agreement(first: Grid, second: Grid) -> float:
    """
    Return the share of walls that lie near the other map's walls, the worse direction.

    Only wall cells count that lie on cells which the other map knows; NaN where either map
    has few.
    """
    return float(np.minimum(_one_way(first, second), _one_way(second, first)))


def _one_way(grid: Grid, other: Grid) -> float:
    """Return the share of wall cells on the other's known cells that lie near its walls."""
    walls = grid.points(grid.occupied)
    walls = walls[_known(walls, other)]
    theirs = other.points(other.occupied)
    if len(walls) < FEWEST or not len(theirs):
        return float('nan')
    distance, _ = cKDTree(theirs).query(walls, distance_upper_bound=TUNING.near)
    return float(np.isfinite(distance).mean())


def _known(points: Array, grid: Grid) -> Array:
    """Mask (N,) of the points (N, 2) on cells that a map calls free or a wall."""
    (row, column), (height, width) = grid.point_to_cell(points).T, grid.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    known: Array = inside & (grid.free | grid.occupied)[row, column]
    return known
