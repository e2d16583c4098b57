# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which cells of a drawn map are drawn anew: time and memory go by their number, not the map's."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Windows = NDArray[np.intp]    # (n, 4), columns x0 to x1, rows y0 to y1


@dataclass(frozen=True, eq=False)
class DirtyCells:
    """The mask (H, W) over the smallest window that holds them, whose cell (0, 0) is `first`."""

    first: NDArray[np.intp]
    mask: NDArray[np.bool_]

    @classmethod
    def of(cls, windows: Windows) -> 'DirtyCells':
        """Return the cells of some windows (n, 4)."""
        first, last = windows[:, :2].min(0), windows[:, 2:].max(0)
        mask = np.zeros((last - first)[::-1], bool)
        for x0, y0, x1, y1 in (windows - np.tile(first, 2)).tolist():
            mask[y0:y1, x0:x1] = True
        return cls(first, mask)

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the map that the mask lies over."""
        (x0, y0), (x1, y1) = self.first.tolist(), (self.first + self.mask.shape[::-1]).tolist()
        return slice(y0, y1), slice(x0, x1)

    def touch(self, windows: Windows) -> NDArray[np.bool_]:
        """Return which windows (n, 4) hold any of them."""
        count = cv2.integral(self.mask.view(np.uint8))   # of dirty cells up to each
        x0, y0, x1, y1 = self._inside(windows).T
        held: NDArray[np.bool_] = count[y1, x1] - count[y0, x1] - count[y1, x0] + count[y0, x0] > 0
        return held

    def within(self, window: Windows) -> NDArray[np.bool_]:
        """Return the mask (h, w) of those in a window (4,)."""
        x0, y0, x1, y1 = self._inside(window[None])[0]
        mask = np.zeros((window[2:] - window[:2])[::-1], bool)
        left, low = self.first - window[:2]
        mask[y0 + low:y1 + low, x0 + left:x1 + left] = self.mask[y0:y1, x0:x1]
        return mask

    def _inside(self, windows: Windows) -> Windows:
        """Return what of windows (n, 4) the mask lies over, in its own columns and rows."""
        inside: Windows = np.clip(windows - np.tile(self.first, 2), 0,
                                  np.tile(self.mask.shape[::-1], 2))
        return inside
