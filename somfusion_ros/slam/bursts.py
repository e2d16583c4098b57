# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans that come in a burst: their stamps do not tell when they were taken.

A computer that stalls stamps what waited meanwhile as it gets to it, some milliseconds apart, and
the odometry likewise. Which odometry belongs to which scan is not known then to better than what
the robot drives between two scans.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class BurstTuning:
    """Which scans come in a burst."""

    least: float = tuned(
        0.05, 's', 'between two scans, however they are stamped; only nearer ones may be a burst, '
        'as logs with a scan per metre are uneven by themselves', 'intel')
    share: float = tuned(
        0.3, 'share of the usual time', 'between two scans, below which they are a burst', 'intel')
    stall: float = tuned(
        2.5, 'times', 'the usual time, from which on a pause may be a stall that a burst follows; '
        'scans of two lasers come in pairs, too', 'by design')
    memory: float = tuned(
        0.05, 'weight', 'of the newest time between two scans in the usual one', 'not measured')
    pause: float = tuned(
        5.0, 's', 'a longer one counts as this in the usual time', 'not measured')
    across: float = tuned(
        0.1, 'share', 'of what is not known along the way', 'not measured')


TUNING = BurstTuning()


class Bursts:
    """Learns how far apart scans are, and tells what odometry may leave out in a burst."""

    def __init__(self) -> None:
        self._usual = 0.0    # mean time [s] between two scans: bursts after stalls keep it
        self._heard, self._stalled = 0, False

    def judge(self, dt: float, velocity: Array) -> tuple[float, Array]:
        """
        Return the time [s] between two scans that are stamped dt [s] apart, and what is unknown.

        The latter is a covariance (3, 3) of the motion, of a robot of a velocity (3,) [m/s, m/s,
        rad/s].
        """
        t, usual = TUNING, self._usual
        self._heard += 1
        self._usual += max(t.memory, 1.0 / self._heard) * (min(dt, t.pause) - usual)
        if dt >= min(t.least, t.share * usual):
            self._stalled = self._heard > 1.0 / t.memory and dt > t.stall * usual
        elif self._stalled:
            return max(usual, t.least), self._unknown(usual * velocity)
        return max(dt, t.least), np.zeros((3, 3))

    @staticmethod
    def _unknown(motion: Array) -> Array:
        """Return the covariance (3, 3) of odometry that may leave out all of a motion (3,)."""
        along = np.hypot(motion[0], motion[1])
        return np.diag([along, TUNING.across * along, motion[2]]) ** 2
