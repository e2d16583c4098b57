# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the scans that a robot told of show: so that it tells no scan that shows nothing new."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline


@dataclass(frozen=True)
class ShownTuning:
    """When a scan shows something new."""

    cell: float = tuned(0.1, 'm', 'edge of the cells in which is noted what was shown',
                        'by design')
    times: int = tuned(2, 'scans', 'in which a surface is shown often enough, so that no single '
                       'beam that passes wipes it out; 1 loses half a percent of the walls',
                       'mines, wean, CSAIL')
    surface: int = tuned(4, 'cells', 'of surface that were not shown so often make a scan new; 10 '
                         'cost a 20th less, and show a 200th less of the walls and a 30th less of '
                         'single posts', 'mines, wean, CSAIL')
    area: float = tuned(0.03, 'm^2', 'that no scan knew make a scan new; with 0.1 the mines cost '
                        'an eighth less, and a tenth of what is free in them is not known',
                        'mines, wean, CSAIL')


TUNING = ShownTuning()
MOST_CELLS = 1 << 26     # 800 m square; beyond, every scan counts as new
MARGIN = 256             # cells by which the raster grows at least


class Shown:
    """A raster over the robot's map: how many scans showed a surface, and what is known."""

    def __init__(self) -> None:
        self._corner = np.zeros(2, np.int64)      # column, row of cell (0, 0) on the lattice
        self._times = np.zeros((0, 0), np.uint8)
        self._known = np.zeros((0, 0), np.uint8)

    def add(self, outline: Outline, pose: Array) -> None:
        """Note what a scan shows, taken at a pose (3,) in the map."""
        if not len(outline.reach) or not self._grow(outline, pose):
            return
        rows, columns = self._surface(outline, pose)
        self._times[rows, columns] = np.minimum(self._times[rows, columns], 254) + 1
        window, free = self._space(outline, pose)
        self._known[window] |= free

    def is_new(self, outline: Outline, pose: Array) -> bool:
        """Tell whether a scan, taken at a pose (3,) in the map, shows what was not shown."""
        if not len(outline.reach):
            return False
        if not self._grow(outline, pose):
            return True
        rows, columns = self._surface(outline, pose)
        often = np.max([self._times[rows + i, columns + j] for i in (-1, 0, 1)
                        for j in (-1, 0, 1)], axis=0, initial=0)
        window, free = self._space(outline, pose)
        unknown = np.count_nonzero(free & ~self._known[window])
        return bool(np.count_nonzero(often < TUNING.times) >= TUNING.surface
                    or unknown * TUNING.cell ** 2 >= TUNING.area)

    def _surface(self, outline: Outline, pose: Array) -> NDArray[np.int64]:
        """Return rows and columns (2, n) of the cells in which a scan sees a surface."""
        at = np.floor(apply(pose, outline.hits) / TUNING.cell).astype(np.int64) - self._corner
        cells: NDArray[np.int64] = np.unique(at[:, ::-1], axis=0).T
        return cells

    def _space(self, outline: Outline, pose: Array
               ) -> tuple[tuple[slice, slice], NDArray[np.uint8]]:
        """Return the rows and columns around a scan, and in them a mask of what it passed."""
        rim = np.floor(apply(pose, outline.rim) / TUNING.cell).astype(np.int64) - self._corner
        (left, low), (right, high) = rim.min(0), rim.max(0) + 1
        mask = np.zeros((high - low, right - left), np.uint8)
        cv2.fillPoly(mask, [(rim - (left, low)).astype(np.int32)], 1)
        return (slice(low, high), slice(left, right)), mask

    def _grow(self, outline: Outline, pose: Array) -> bool:
        """Make room for a scan; return False where the raster would be too large."""
        rim = np.floor(apply(pose, outline.rim) / TUNING.cell) - self._corner
        low, high = rim.min(0) - 2, rim.max(0) + 3
        size = np.array(self._times.shape[::-1])
        if (low >= 0).all() and (high <= size).all():
            return True
        if size.min() == 0:
            first, last = low - MARGIN, high + MARGIN
        else:
            first = np.where(low < 0, low - np.maximum(MARGIN, size // 4), 0)
            last = np.where(high > size, high + np.maximum(MARGIN, size // 4), size)
        if not (np.isfinite(first).all() and np.isfinite(last).all()
                and np.prod(last - first) <= MOST_CELLS):
            return False
        before, after = (-first).astype(int), (last - size).astype(int)
        around = [(before[1], after[1]), (before[0], after[0])]
        if size.min() == 0:
            shape = (last - first).astype(int)
            self._times, self._known = (np.zeros(shape[::-1], np.uint8) for _ in range(2))
        else:
            self._times, self._known = (np.pad(part, around)
                                        for part in (self._times, self._known))
        self._corner = self._corner + first.astype(np.int64)
        return True
