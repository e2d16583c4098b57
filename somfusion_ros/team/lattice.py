# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the cells of one version of a map lie in another, which has grown or shrunk."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import compose, inverse
from somfusion_ros.grid import UNKNOWN
from somfusion_ros.settings import tuned
from somfusion_ros.team.shared_map import MapCells

MAX_SHIFT = 1 << 20   # cells that a map may grow beyond another version


@dataclass(frozen=True)
class LatticeTuning:
    """When two maps lie on one lattice."""

    whole: float = tuned(
        1e-3, 'cells', 'lattices that are nearer to a whole number of cells apart are one',
        'by design')


TUNING = LatticeTuning()


def corner_in(key: MapCells, cells: MapCells) -> tuple[int, int] | None:
    """Return row and column of the key's corner in a newer map; None where the lattices differ."""
    if key.resolution != cells.resolution or key.T_frame_grid.theta != cells.T_frame_grid.theta:
        return None
    at = compose(inverse(cells.T_frame_grid), key.T_frame_grid)[:2] / cells.resolution
    whole = np.rint(at)
    if np.abs(at - whole).max() > TUNING.whole or np.abs(whole).max() > MAX_SHIFT:
        return None
    return int(whole[1]), int(whole[0])


def laid_into(values: NDArray[np.int8], shape: tuple[int, int],
              corner: tuple[int, int]) -> NDArray[np.int8]:
    """Lay cells into an unknown map of another shape, with their corner at (row, column)."""
    result = np.full(shape, UNKNOWN, np.int8)
    here, there = zip(*(_overlap(first, count, size) for first, count, size in
                        zip(corner, values.shape, shape)), strict=True)
    result[here] = values[there]
    return result


def _overlap(first: int, count: int, size: int) -> tuple[slice, slice]:
    """Return the slices of the cells that a row of `count` shares with one of `size`, in both."""
    low, high = max(first, 0), max(min(first + count, size), 0)
    low = min(low, high)
    return slice(low, high), slice(low - first, high - first)
