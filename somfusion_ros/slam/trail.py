# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot was at every scan, relative to the views; thinned once it is long."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array

MOST = 24_000    # scans; 40 minutes at 10 Hz, 0.6 MB
ROOM = 1024      # scans by which the arrays grow, at least


class Trail:
    """
    Rows of stamp [s], view, and T_view_base (3,), by age.

    When there are MOST of them, every second of the older half is dropped: of the newest half
    every scan is kept, of older ones fewer and fewer, and memory is bounded. before: how many
    rows are of an earlier run.
    """

    def __init__(self, rows: Array | None = None) -> None:
        rows = np.zeros((0, 5)) if rows is None else rows
        self._stamps = np.array(rows[:, 0], float)
        self._views = rows[:, 1].astype(np.int32)
        self._poses = rows[:, 2:].astype(np.float32)     # to 0.1 um, as views lie near
        self._n = self.before = len(rows)

    def __len__(self) -> int:
        return self._n

    @property
    def rows(self) -> Array:
        """Rows (n, 5)."""
        return np.column_stack([self.stamps, self.views, self.poses])

    @property
    def stamps(self) -> Array:
        """Stamps (n,) [s]; a view, not a copy."""
        return self._stamps[:self._n]

    @property
    def views(self) -> NDArray[np.intp]:
        """Views (n,) that the poses hang on."""
        return self._views[:self._n].astype(np.intp)

    @property
    def poses(self) -> Array:
        """Poses T_view_base (n, 3)."""
        return self._poses[:self._n].astype(float)

    def append(self, stamp: float, view: int, T_view_base: Array) -> None:
        """Add a scan."""
        if self._n >= MOST:
            self._keep(np.r_[0:self._n // 2:2, self._n // 2:self._n])
        if self._n == len(self._stamps):
            self._make_room(min(max(ROOM, self._n // 2), max(1, MOST - self._n)))
        self._stamps[self._n], self._views[self._n] = stamp, view
        self._poses[self._n] = T_view_base
        self._n += 1

    def _keep(self, rows: NDArray[np.intp]) -> None:
        """Drop all rows but some, by age."""
        self._n, self.before = len(rows), int(np.searchsorted(rows, self.before))
        for column in (self._stamps, self._views, self._poses):
            column[:self._n] = column[rows]

    def _make_room(self, more: int) -> None:
        """Make room for more rows."""
        self._stamps = np.concatenate([self._stamps, np.zeros(more)])
        self._views = np.concatenate([self._views, np.zeros(more, np.int32)])
        self._poses = np.concatenate([self._poses, np.zeros((more, 3), np.float32)])
