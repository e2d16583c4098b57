# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How each scan is drawn in the map now."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False)
class DrawnScans:
    """
    How n scans are drawn: whether they are, at poses (n, 3), within bounds (n, 4) [m].

    Those that do not fit into the map are left out.
    """

    old: NDArray[np.bool_]
    poses: Array
    bounds: Array
    left_out: NDArray[np.bool_]

    @classmethod
    def of(cls, n: int) -> 'DrawnScans':
        """Return n scans of which none is drawn."""
        return cls(np.zeros(n, bool), np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(n, bool))

    def chosen(self, rows: Sequence[int]) -> 'DrawnScans':
        """Return some of them, by their rows, in this order; -1 is one that is not drawn."""
        index = np.array(rows, np.intp)
        chosen, old = DrawnScans.of(len(index)), index >= 0
        for part in fields(self):
            getattr(chosen, part.name)[old] = getattr(self, part.name)[index[old]]
        return chosen
