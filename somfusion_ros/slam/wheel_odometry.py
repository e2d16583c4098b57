# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry of two wheel encoders."""

import numpy as np
from somfusion_ros.geometry import Array, compose
from somfusion_ros.slam.motion import arc

WHEEL_SLIP = 0.02  # [m] of a wheel's random slip after one metre of its travel


class WheelOdometry:
    """
    Dead reckoning of a differential drive from two wheel encoders (section II-A).

    Each wheel slips at random with its own travel (Chong and Kleeman 1997): slip (3,) is what
    that has added up to in the covariance of travel and turn, as in `Odometry`.
    """

    def __init__(self, wheel_radius: float, wheel_separation: float) -> None:
        if not (wheel_radius > 0 and wheel_separation > 0):
            raise ValueError('wheel radius and separation must be positive, got '
                             f'{wheel_radius}, {wheel_separation}')
        self._radius, self._separation = wheel_radius, wheel_separation
        self._last: Array | None = None
        self._pose, self.slip = np.zeros(3), np.zeros(3)

    def update(self, left: float, right: float) -> Array:
        """Integrate wheel positions [rad]; return T_odom_base (3,). NaN is passed on."""
        wheels = np.array([left, right], dtype=float)
        if self._last is not None and np.isfinite(wheels).all():
            dl, dr = self._radius * (wheels - self._last)
            self._pose = compose(self._pose, arc(0.5 * (dl + dr), (dr - dl) / self._separation))
            left, right, b = WHEEL_SLIP ** 2 * abs(dl), WHEEL_SLIP ** 2 * abs(dr), self._separation
            self.slip = self.slip + (
                0.25 * (left + right), 0.5 * (right - left) / b, (left + right) / b ** 2)
        if not np.isfinite(wheels).all():
            return np.full(3, np.nan)
        self._last = wheels
        return self._pose.copy()
