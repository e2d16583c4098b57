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

from collections import deque
from dataclasses import dataclass

import numpy as np

from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.motion import Odometry

PRIOR_TURN = (0.10, 0.04, 0.02)   # sigmas of lag [s], turn scale, veer [rad / m]
PRIOR_TRAVEL = 0.04               # sigma of the travel scale
TURN_NOISE = (0.015, 0.10)        # [rad] and share of the turn that is not systematic
TRAVEL_NOISE = (0.015, 0.05)      # [m] and share of the travel
GATE = 3.0                        # sigmas beyond which a step is a slip, not a calibration
MAX_LAG = 0.5                     # [s]
TURNING = 0.15                    # [rad/s] below which a turn rate is the matches' noise


@dataclass(frozen=True, eq=False)
class _Step:
    """One step between stamps [s]: by odometry (3,), as matched (3,), its sigma along [m]."""

    start: float
    end: float
    odometry: Array
    matched: Array
    along: float

    @property
    def time(self) -> float:
        """Length [s] of the step."""
        return self.end - self.start

    @property
    def turn_rate(self) -> float:
        """Mean turn rate [rad/s], as matched."""
        return float(self.matched[2]) / self.time


class Calibration:
    """Coefficients of the odometry's systematic errors, with their covariance."""

    def __init__(self) -> None:
        self.turning, self.P_turning = np.zeros(3), np.diag(PRIOR_TURN) ** 2
        self.travelling, self.P_travelling = np.zeros(1), np.array([[PRIOR_TRAVEL ** 2]])
        self._steps: deque[_Step] = deque(maxlen=3)

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

    def learn(self, previous: Odometry, current: Odometry, matched: Array, along: float) -> None:
        """
        Take in one step: its odometry at both ends, and the motion (3,) that was matched.

        along [m] is the match's sigma along the motion. A step counts once the next one is
        there, as the change of speed over it is seen by its neighbours.
        """
        if self._steps and self._steps[-1].end != previous.stamp:
            self._steps.clear()
        if not previous.stamp < current.stamp:
            return
        self._steps.append(_Step(previous.stamp, current.stamp,
                                 between(previous.pose, current.pose), matched, along))
        if len(self._steps) == 3:
            self._take(*self._steps)

    def _take(self, before: '_Step', now: '_Step', after: '_Step') -> None:
        """
        Update by a step between two others.

        Both odometry and match err at random. What errs on both sides of an equation would pass
        for scale or lag: turn and travel are the mean of the two, a change of speed is that of
        the matches, and turns that may be noise say nothing.
        """
        odometry, matched = now.odometry, now.matched
        turn, travel = 0.5 * (odometry[2] + matched[2]), 0.5 * (odometry[0] + matched[0])
        change = 0.5 * (after.turn_rate - before.turn_rate)
        h = np.array([change if abs(change) > TURNING else 0.0,
                      turn if abs(turn) > TURNING * now.time else 0.0, travel])
        # The odometry was read with the lag known by now; what remains is the rest of it.
        error = matched[2] - odometry[2] + self.turning[0] * h[0]
        noise = TURN_NOISE[0] + TURN_NOISE[1] * abs(turn)
        _update(self.turning, self.P_turning, h, error, noise)
        noise = np.hypot(TRAVEL_NOISE[0] + TRAVEL_NOISE[1] * abs(travel), now.along)
        _update(self.travelling, self.P_travelling, h[2:], matched[0] - odometry[0], noise)


def _update(x: Array, P: Array, h: Array, z: float, noise: float) -> None:
    """Kalman update, in place, of constant coefficients x (n,) by one z = h . x + noise."""
    innovation, variance = z - h @ x, h @ P @ h + noise ** 2
    if innovation ** 2 > GATE ** 2 * variance:
        return
    K = P @ h / variance
    x += K * innovation
    P -= np.outer(K, h @ P)
