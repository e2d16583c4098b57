# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where two placed maps agree and where they contradict each other (11)."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Pose
from somfusion_ros.grid import Grid

AGREE, CONFLICT, NEITHER = 1, -1, 0


def compare(target: Grid, source: Grid, T_target_source: Pose) -> NDArray[np.int8]:
    """
    Compare the source's cells with the target's cells that they fall on.

    Return (H, W) over the source's cells: AGREE where both are free, or a wall lies within one
    cell of a wall; CONFLICT where one is free and the other a wall; NEITHER where either is
    unknown.
    """
    known = source.free | source.occupied
    verdict = np.zeros(source.shape, np.int8)
    rows, columns = np.nonzero(known)
    cells = target.point_to_cell(apply(T_target_source, source.points(known)))
    height, width = target.shape
    inside = ((cells >= 1) & (cells < (height - 1, width - 1))).all(1)
    rows, columns, (i, j) = rows[inside], columns[inside], cells[inside].T
    near_wall, wall, free = _grown(target.occupied), target.occupied, target.free
    is_wall = source.occupied[rows, columns]
    source_near = _grown(source.occupied)[rows, columns]
    agree = np.where(is_wall, near_wall[i, j], free[i, j] | (wall[i, j] & source_near))
    conflict = np.where(is_wall, free[i, j], wall[i, j]) & ~agree
    verdict[rows, columns] = np.where(agree, AGREE, np.where(conflict, CONFLICT, NEITHER))
    return verdict


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask (H, W) grown by one cell in all eight directions."""
    padded = np.pad(mask, 1)
    grown = np.zeros_like(mask)
    for i in range(3):
        for j in range(3):
            grown |= padded[i:i + mask.shape[0], j:j + mask.shape[1]]
    return grown
