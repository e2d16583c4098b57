# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points on surfaces with their normals: what a scan saw, and what a scan is matched against."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array


class Surface:
    """
    Points (N, 2) [m] with unit normals (N, 2), zero where there is too little surface.

    As complex numbers (N,) they turn by one product, in a third of the time.
    """

    points: Array
    normals: Array

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def bare(self) -> NDArray[np.bool_]:
        """Mask (N,) of the points without a normal."""
        bare: NDArray[np.bool_] = ~(self.normals != 0.0).any(1)
        return bare

    @cached_property
    def plane(self) -> NDArray[np.complex128]:
        """Points x + i y."""
        return _complex(self.points)

    @cached_property
    def facing(self) -> NDArray[np.complex128]:
        """Normals as complex numbers."""
        return _complex(self.normals)


def _complex(vectors: Array) -> NDArray[np.complex128]:
    """Return the vectors (N, 2) as complex numbers (N,)."""
    return np.ascontiguousarray(vectors, dtype=float).view(complex)[:, 0]
