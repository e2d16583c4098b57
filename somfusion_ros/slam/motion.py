# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry: interpolation by stamp, two wheel encoders, and the noise of an increment."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False)
class Odometry:
    """
    The robot's odometry at one moment.

    stamp [s], pose T_odom_base (3,), twist (3,) [m/s, m/s, rad/s] in the base frame, and, where
    it comes from encoders, the wheel positions (2,) left, right [rad].
    """

    stamp: float
    pose: Array
    twist: Array
    wheels: Array | None = None
