# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chains of views that follow one another: what a robot saw in one go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Chains:
    """The first view of each chain, (m,), of n views as they were at one moment."""

    begins: NDArray[np.intp]
    n: int

    def of(self, view: int) -> range:
        """Return the chain with a view in it."""
        after = int(np.searchsorted(self.begins, view, side='right'))
        return range(int(self.begins[after - 1]),
                     int(self.begins[after]) if after < len(self.begins) else self.n)
