# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 (equations (1)-(3)) cell by cell, the reference of the package's segmentation."""

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.intp]


def grow(cells: Cells, radius: float, delta_radius: float) -> NDArray[np.intp]:
    """
    Label cells (N, 2): circles around start cells, next starts in the ring at the rim.

    Rings are 1 cell wide, or `delta_radius` where that is empty.
    """
    labels = np.full(len(cells), -1, np.intp)
    for label in range(len(cells)):
        rest = np.flatnonzero(labels < 0)
        if len(rest) == 0:
            break
        starts, seen = [int(rest[0])], {int(rest[0])}
        while starts:
            start = starts.pop()
            distance = np.hypot(*(cells - cells[start]).T)
            circle = ((labels < 0) | (labels == label)) & (distance <= radius)
            labels[circle] = label                                                       # (1)
            fresh = set(np.flatnonzero(circle & (distance > radius - 1.0)).tolist()) - seen   # (2)
            if not fresh:                                                                # (3)
                rim = circle & (distance > radius - delta_radius)
                fresh = set(np.flatnonzero(rim).tolist()) - seen
            seen |= fresh
            starts.extend(sorted(fresh))
    return labels
