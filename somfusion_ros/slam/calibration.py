# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Systematic odometry errors, learned from the matches while the robot drives.

Wheel radii and their separation are known to a few percent, and the clocks of laser and wheels
differ by up to some tenths of a second. Each matched step tells by how much the odometry was
wrong; what is proportional to the turn, to the travel, or to the change of speed is systematic:

    turn_matched - turn   = lag * change of turn rate + turn_scale * turn + veer * travel
    travel_matched - travel = travel_scale * travel

A Kalman filter with constant state holds each line's coefficients and their uncertainty.
"""

import numpy as np

from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.motion import Odometry

PRIOR_TURN = (0.10, 0.04, 0.02)   # sigmas of lag [s], turn scale, veer [rad / m]
PRIOR_TRAVEL = 0.04               # sigma of the travel scale
TURN_NOISE = (0.015, 0.10)        # [rad] and share of the turn that is not systematic
TRAVEL_NOISE = (0.015, 0.05)      # [m] and share of the travel
GATE = 3.0                        # sigmas beyond which a step is a slip, not a calibration
MAX_LAG = 0.5                     # [s]


class Calibration:
    """Coefficients of the odometry's systematic errors, with their covariance."""

    def __init__(self) -> None:
        self.turning, self.P_turning = np.zeros(3), np.diag(PRIOR_TURN) ** 2
        self.travelling, self.P_travelling = np.zeros(1), np.array([[PRIOR_TRAVEL ** 2]])

    @property
    def lag(self) -> float:
        """Time [s] to add to a scan's stamp to find the odometry that belongs to it."""
        return float(np.clip(self.turning[0], -MAX_LAG, MAX_LAG))

    def correct(self, step: Array) -> Array:
        """Odometry increment (3,) without its systematic errors."""
        travel, (_, scale, veer) = step[0], self.turning
        turn = step[2] * (1.0 + scale) + veer * travel
        stretched = step[:2] * (1.0 + self.travelling[0])
        bend = 0.5 * (turn - step[2])
        c, s = np.cos(bend), np.sin(bend)
        return np.array([c * stretched[0] - s * stretched[1],
                         s * stretched[0] + c * stretched[1], turn])

    def learn(self, previous: Odometry, current: Odometry, matched: Array) -> None:
        """Take in one step: its odometry at both ends, and the motion (3,) that was matched."""
        step = between(previous.pose, current.pose)
        h = np.array([current.twist[2] - previous.twist[2], step[2], step[0]])
        # The odometry was read with the lag known by now; what remains is the rest of it.
        error = matched[2] - step[2] + self.turning[0] * h[0]
        noise = TURN_NOISE[0] + TURN_NOISE[1] * abs(step[2])
        _update(self.turning, self.P_turning, h, error, noise)
        noise = TRAVEL_NOISE[0] + TRAVEL_NOISE[1] * abs(step[0])
        _update(self.travelling, self.P_travelling, step[:1], matched[0] - step[0], noise)


def _update(x: Array, P: Array, h: Array, z: float, noise: float) -> None:
    """Kalman update, in place, of constant coefficients x (n,) by one z = h . x + noise."""
    innovation, variance = z - h @ x, h @ P @ h + noise ** 2
    if innovation ** 2 > GATE ** 2 * variance:
        return
    K = P @ h / variance
    x += K * innovation
    P -= np.outer(K, h @ P)
