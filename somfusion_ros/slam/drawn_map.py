# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a drawn map says of points: whether a wall is there, or free space."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, inverse
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class DrawnMapTuning:
    """What is taken for free space."""

    border: float = tuned(
        0.3, 'm', 'of free space along walls, where a point speaks against nothing', 'wean')


TUNING = DrawnMapTuning()


class DrawnMap:
    """
    A drawn map that is asked about points in its frame.

    People who walked through a view are in its surface, but not in the map.
    """

    def __init__(self, grid: Grid) -> None:
        edge = 2 * int(np.ceil(TUNING.border / grid.resolution)) + 1
        self._grid = grid
        self._least = cv2.erode(grid.evidence, np.ones((3, 3), np.uint8), borderValue=1.0)
        self._deep = cv2.erode(grid.free.astype(np.uint8), np.ones((edge, edge), np.uint8),
                               borderValue=0)

    def stands(self, points: Array) -> NDArray[np.bool_]:
        """Return which points (N, 2) lie on a wall, or next to one."""
        return self._at(self._least, points, 1.0) < 0.0

    def free(self, points: Array) -> NDArray[np.bool_]:
        """
        Return which points (N, 2) lie in free space, and not at its border.

        Walls that are grazed, and are drawn from few beams, lie at the border.
        """
        return self._at(self._deep, points, 0.0) > 0.0

    def _at(self, image: Array, points: Array, outside: float) -> Array:
        """Return what an image of the grid's shape holds at points (N, 2)."""
        local = apply(inverse(self._grid.T_frame_grid), points) / self._grid.resolution
        x, y = np.floor(local).astype(np.intp).T
        height, width = image.shape
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        found = np.full(len(points), outside, np.float32)
        found[inside] = image[y[inside], x[inside]]
        return found
