# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion where there is no odometry: the robot goes on as it was matched to move."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from somfusion_ros.geometry import Array, between, compose
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


TUNING = GuessTuning()


class TurnRate(NamedTuple):
    """What a gyroscope tells: the turn rate [rad/s] about the vertical axis at a stamp [s]."""

    stamp: float
    rate: float


class MotionGuess:
    """
    Stands in for odometry: `at` predicts, `learn` takes what was matched.

    The speed is that from the middle of one sweep to the middle of the next. The pose at a scan's
    stamp depends on the speed that the sweep was straightened with: where it was too fast, the
    scan seems to lie behind, by half of what was too much in a sweep. A speed from stamp to stamp
    would therefore be wrong the other way the next time, and by as much or more: a lidar that
    stands still would begin to swing. The pose at the middle does not depend on it.
    """

    def __init__(self) -> None:
        self._pose, self._slip, self._twist = np.zeros(3), np.zeros(4), np.zeros(3)
        self._stamp: float | None = None
        self._last: Step | None = None
        self._to_middle = np.zeros(3)   # (3,): way from its stamp to the middle of its sweep

    def at(self, stamp: float) -> Odometry:
        """Predict the odometry at a stamp [s], later than all before."""
        passed = 0.0 if self._stamp is None else max(stamp - self._stamp, 0.0)
        time = min(passed, TUNING.longest)
        step = swept(self._twist, time)
        spread = 0.5 * np.array((TUNING.acceleration, TUNING.turning)) * passed ** 2
        moved, turned = np.hypot(np.minimum(spread, (1.0, 1.0)), TUNING.floor)
        self._pose = compose(self._pose, step)
        if passed > 0.0:
            self._slip = self._slip + (moved ** 2, 0.0, turned ** 2, moved ** 2)
        self._stamp = stamp
        return Odometry(stamp, self._pose, self._twist, self._slip, measured=False)

    def learn(self, step: Step, twist: Array, sweep: float) -> None:
        """Take the step that a scan made, whose sweep [s] was straightened with a twist (3,)."""
        last, self._last = self._last, step
        before, self._to_middle = self._to_middle, swept(twist, 0.5 * sweep)
        if last is None or not last.stamp < step.stamp:
            return
        if step.moved is not None and last.accepted:
            moved = between(before, compose(step.moved, self._to_middle))
            found = mean_twist(moved, step.stamp - last.stamp)
            limit = np.array(TUNING.fastest)[[0, 0, 1]]
            self._twist = np.clip(found, -limit, limit)
        elif not step.matched:
            self._twist = 0.5 * self._twist
