# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much two versions of a map differ, by their walls and their area."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned

WALL_TOLERANCE = 1                 # cells that a wall may move without being a change


@dataclass(frozen=True)
class ChangeTuning:
    """When a map is another one."""

    new_frame: float = tuned(
        0.7, '', 'a map that lost this share of its walls, and shrank, was begun anew; a loop '
        'that closes bends away less', 'not measured')
    shrunk: float = tuned(
        0.5, '', 'share of the known area below which a map has shrunk', 'not measured')


TUNING = ChangeTuning()


def change(old: Grid, new: Grid) -> float:
    """Return the share of the walls of either map that the other one does not have, 0..1."""
    if old is new or (old.shape == new.shape and old.T_frame_grid == new.T_frame_grid
                      and np.array_equal(old.evidence, new.evidence)):
        return 0.0
    return max(missing_walls(old, new), missing_walls(new, old))


def missing_walls(grid: Grid, other: Grid) -> float:
    """Return the share of the walls of a map that the other one does not have, 0..1."""
    points = grid.points(grid.occupied)
    return 1.0 - float(_on_wall(points, other).mean()) if len(points) else 0.0


def begun_anew(old: Grid, new: Grid) -> bool:
    """Return whether a map was begun anew: most walls and most of the known area are gone."""
    area = np.count_nonzero(new.known) * new.resolution ** 2
    area_before = np.count_nonzero(old.known) * old.resolution ** 2
    return bool(area < TUNING.shrunk * area_before and missing_walls(old, new) > TUNING.new_frame)


def _on_wall(points: Array, grid: Grid) -> NDArray[np.bool_]:
    """Mask of the map points (N, 2) that lie on a wall of a map, or one cell beside."""
    size = 2 * WALL_TOLERANCE + 1
    walls = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((size, size), np.uint8))
    cells = grid.point_to_cell(points)
    inside = ((cells >= 0) & (cells < grid.shape)).all(1)
    hit = np.zeros(len(points), dtype=bool)
    hit[inside] = walls[tuple(cells[inside].T)] > 0
    return hit
