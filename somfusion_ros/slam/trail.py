# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot was at every scan, relative to the views; thinned once it is long."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array

MOST = 36_000    # scans; 1 hour at 10 Hz, 1.4 MB
ROOM = 1024      # scans by which the arrays grow, at least


class Trail:
    """
    Rows of stamp [s], view, and T_view_base (3,), by age.

    When there are MOST of them, every second of the older half is dropped: the newest half-hour
    keeps every scan, older ones fewer and fewer, and memory is bounded.
    """

    def __init__(self, rows: Array | None = None) -> None:
        self._rows = np.zeros((ROOM, 5)) if rows is None else np.array(rows, float)
        self._n = 0 if rows is None else len(rows)

    def __len__(self) -> int:
        return self._n

    @property
    def rows(self) -> Array:
        """Rows (n, 5); a view, not a copy."""
        return self._rows[:self._n]

    @property
    def stamps(self) -> Array:
        """Stamps (n,) [s]; a view, not a copy."""
        return self._rows[:self._n, 0]

    @property
    def views(self) -> NDArray[np.intp]:
        """Views (n,) that the poses hang on."""
        return self._rows[:self._n, 1].astype(np.intp)

    @property
    def poses(self) -> Array:
        """Poses T_view_base (n, 3); a view, not a copy."""
        return self._rows[:self._n, 2:]

    def append(self, stamp: float, view: int, T_view_base: Array) -> None:
        """Add a scan."""
        if self._n >= MOST:
            self._thin()
        if self._n == len(self._rows):
            more = max(ROOM, self._n // 2)
            self._rows = np.concatenate([self._rows, np.zeros((more, 5))])
        self._rows[self._n, 0], self._rows[self._n, 1] = stamp, view
        self._rows[self._n, 2:] = T_view_base
        self._n += 1

    def _thin(self) -> None:
        """Drop every second row of the older half."""
        half = self._n // 2
        rows = np.concatenate([self._rows[:half:2], self._rows[half:self._n]])
        self._n = len(rows)
        self._rows[:self._n] = rows
