# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A measured pose of one view seen from another: what the estimate is made of."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False, slots=True)
class Constraint:
    """A measured pose z (3,) of view `second` seen from view `first`, with covariance R (3, 3)."""

    first: int
    second: int
    z: Array
    R: Array
