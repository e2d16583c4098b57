# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion where there is no odometry: the robot goes on as it was matched to move.

A gyroscope tells its turns where there is one; its bias is learned from the matches.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from somfusion_ros.geometry import between, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.motion import mean_twist, Odometry, swept
from somfusion_ros.slam.step import Step


@dataclass(frozen=True)
class GuessTuning:
    """How far a robot may move otherwise than it did."""

    acceleration: float = tuned(
        2.0, 'm/s^2', 'sigma of what nobody measures, along and across',
        'mit-csail, mines_exp1, intel without their odometry')
    turning: float = tuned(
        4.0, 'rad/s^2', 'sigma of the same of the turn rate',
        'mit-csail, mines_exp1, intel without their odometry')
    floor: tuple[float, float] = tuned(
        (0.02, 0.02), 'm, rad', 'sigma of a step, as the matched speed is noisy', 'by design')
    longest: float = tuned(
        1.0, 's', 'for which a robot goes on; after a longer pause it may be anywhere near',
        'by design')
    fastest: tuple[float, float] = tuned(
        (2.0, 3.0), 'm/s, rad/s', 'at which a robot may go on; a wrong match tells more',
        'by design')
    gyro: tuple[float, float] = tuned(
        (0.003, 0.02), 'rad, share', 'sigma of a turn that a gyroscope tells: floor and growth',
        'by design')
    bias: float = tuned(
        0.05, 'weight', 'of the newest match in the bias of the gyroscope', 'not measured')


TUNING = GuessTuning()
SAMPLES = 4000   # of the gyroscope, kept for scans that come late


class TurnRate(NamedTuple):
    """What a gyroscope tells: the turn rate [rad/s] about the vertical axis at a stamp [s]."""

    stamp: float
    rate: float


class MotionGuess:
    """Stands in for odometry: `at` predicts, `learn` takes what was matched."""

    def __init__(self) -> None:
        self._pose, self._slip, self._twist = np.zeros(3), np.zeros(4), np.zeros(3)
        self._stamp: float | None = None
        self._last: Step | None = None
        self._rates: deque[tuple[float, float]] = deque(maxlen=SAMPLES)
        self._bias, self._turned = 0.0, 0.0

    def add_turn_rate(self, stamp: float, rate: float) -> None:
        """Take the turn rate [rad/s] of a gyroscope at a stamp [s]; what runs back is left out."""
        if np.isfinite((stamp, rate)).all() and (
                not self._rates or stamp > self._rates[-1][0]):
            self._rates.append((stamp, rate))

    def at(self, stamp: float) -> Odometry:
        """Predict the odometry at a stamp [s], later than all before."""
        passed = 0.0 if self._stamp is None else max(stamp - self._stamp, 0.0)
        time = min(passed, TUNING.longest)
        step = swept(self._twist, time)
        spread = 0.5 * np.array((TUNING.acceleration, TUNING.turning)) * passed ** 2
        moved, turned = np.hypot(np.minimum(spread, (1.0, 1.0)), TUNING.floor)
        told = self._turn(stamp - passed, stamp)
        if told is not None:
            step[2] = told - self._bias * passed
            turned = TUNING.gyro[0] + TUNING.gyro[1] * abs(step[2])
        self._turned = 0.0 if told is None else told
        self._pose = compose(self._pose, step)
        if passed > 0.0:
            self._slip = self._slip + (moved ** 2, 0.0, turned ** 2, moved ** 2)
        self._stamp = stamp
        return Odometry(stamp, self._pose, self._twist, self._slip, measured=False)

    def learn(self, step: Step) -> None:
        """Take the step that a scan made."""
        last, self._last = self._last, step
        if last is None or not last.stamp < step.stamp:
            return
        if not step.matched:
            self._twist = 0.5 * self._twist
            return
        time = step.stamp - last.stamp
        moved = between(np.array(last.pose), np.array(step.pose))
        if last.matched or last.is_view:
            twist, limit = mean_twist(moved, time), np.array(TUNING.fastest)[[0, 0, 1]]
            self._twist = np.clip(twist, -limit, limit)
            if self._turned:
                rate = (self._turned - float(moved[2])) / time
                self._bias += TUNING.bias * float(np.clip(rate - self._bias, -0.1, 0.1))

    def _turn(self, start: float, end: float) -> float | None:
        """Turn [rad] that the gyroscope told between two stamps; None where it did not."""
        if len(self._rates) < 2 or self._rates[0][0] > start or end - self._rates[-1][0] > 0.1:
            return None
        stamps, rates = np.array(self._rates).T
        inside = (stamps > start) & (stamps < end)
        at = np.concatenate([[start], stamps[inside], [end]])
        told = np.interp(at, stamps, rates)
        return float(0.5 * (told[1:] + told[:-1]) @ np.diff(at)) if end > start else None
