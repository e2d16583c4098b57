# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A smooth displacement of the plane, held on a lattice of nodes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False)
class Warp:
    """Displacements (rows, columns, 2) [m] on a lattice with its first node at `corner` [m]."""

    displacements: NDArray[np.float32]
    corner: Array
    spacing: float

    def at(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the displacement (2, ...) [m] at points (2, ...) [m] of the target's frame."""
        flat = points.reshape(2, -1)
        index, share = lattice_shares(flat, self.corner, self.spacing,
                                      self.displacements.shape[:2])
        moves = [(np.take(axis, index) * share).sum(0)
                 for axis in np.moveaxis(self.displacements, -1, 0).reshape(2, -1)]
        return np.stack(moves).reshape(points.shape)


def lattice_shares(points: Array, corner: Array, spacing: float,
                   shape: tuple[int, int]) -> tuple[Index, NDArray[np.float32]]:
    """Return nodes (4, N) of the lattice around points (2, N), and their shares (4, N)."""
    rows, columns = shape
    x, y = ((points - np.asarray(corner, points.dtype)[:, None]) / spacing).astype(np.float32)
    x, y = np.clip(x, 0.0, columns - 1.001), np.clip(y, 0.0, rows - 1.001)
    column, row = x.astype(np.intp), y.astype(np.intp)
    x, y = x - column.astype(np.float32), y - row.astype(np.float32)
    first = row * columns + column
    index = np.stack([first, first + 1, first + columns, first + columns + 1])
    return index, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
