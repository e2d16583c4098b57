# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Turns that a gyroscope tells, beside wheels or where there is no odometry.

Its bias is learned from the matches, and so are sign and unit: an Imu may hang upside down, and
some drivers tell degrees. One that tells other turns than the matches do is not used.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import Array, between, rotation
from somfusion_ros.settings import tuned
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.step import Step


@dataclass(frozen=True)
class GyroTuning:
    """How far a gyroscope is believed."""

    sigma: tuple[float, float] = tuned(
        (0.003, 0.02), 'rad, share', 'of a turn that it tells: floor and growth', 'by design')
    drift: float = tuned(
        0.02, 'rad/s', 'sigma of its bias before the first match; it falls with the root of their '
        'number, to a tenth', 'by design')
    bias: float = tuned(
        0.05, 'weight', 'of the newest match in its bias', 'test/unit/test_motion_guess.py')
    gap: float = tuned(
        0.5, 's', 'between two samples, after which it begins anew', 'by design')
    ahead: float = tuned(
        0.1, 's', 'after its newest sample, for which it is taken to go on', 'by design')
    wheeled: float = tuned(
        0.2, 'rad', 'of turns of the wheels after which they are known roughly', 'by design')
    turned: float = tuned(
        1.0, 'rad', 'of matched turns after which sign and unit are known', 'by design')


TUNING = GyroTuning()
SAMPLES = 4000   # that are kept for scans that come late
FASTEST = 8.0       # [rad/s] that a robot turns
LEAST_TURN = 0.02   # [rad] between two scans, that tells something
UNITS = {'rad/s': 1.0, 'rad/s, upside down': -1.0,
         'deg/s': np.pi / 180.0, 'deg/s, upside down': -np.pi / 180.0}
FITS = (0.7, 1.4)     # ratio of turns told and matched, in the right unit
ROUGHLY = (0.3, 4.0)  # the same, where wheels may slip
LONGEST = 3.0         # [s] between two scans that tell something


class Gyro:
    """
    Adds turn rates up to a heading.

    Parameters
    ----------
    count : called with the name of each fault, and its reason
    trusted : whether it is used before sign and unit are known

    """

    def __init__(self, count: Callable[..., None], trusted: bool) -> None:
        self._count, self._trusted = count, trusted
        self._angles: deque[tuple[float, float, float]] = deque(maxlen=SAMPLES)  # stamp, sum, rate
        self._run, self._bias, self._factor = 0, 0.0, 1.0
        self._taken, self._at = 0.0, 0.0      # angle [rad] by the bias, up to a stamp [s]
        self._known, self._learned = False, 0
        self._sums = np.zeros(2)              # of turns told and matched
        self._rough = np.zeros(2)             # of turns told, and turned by the wheels
        self._wheels: tuple[Odometry, float | None] | None = None
        self._last: tuple[Step, float] | None = None    # and its stamp [s] by the gyroscope

    def add(self, stamp: float, rate: float) -> None:
        """Take the turn rate [rad/s] at a stamp [s]; what runs back is left out."""
        if not np.isfinite((stamp, rate)).all():
            return
        if not self._known and abs(rate) > FASTEST:
            self._trusted = False   # degrees?
        last = self._angles[-1] if self._angles else None
        if last is None or not 0.0 < stamp - last[0] <= TUNING.gap:
            if last is not None and last[0] - TUNING.gap < stamp <= last[0]:
                return
            self._angles.clear()
            self._run += 1
            self._angles.append((stamp, 0.0, rate))
            return
        self._angles.append((stamp, last[1] + 0.5 * (last[2] + rate) * (stamp - last[0]), rate))

    def beside(self, odometry: Odometry, lag: float = 0.0) -> Odometry:
        """Return the odometry with the heading that the gyroscope has then, if it has one."""
        if not (self._trusted or self._known):
            self._compare(odometry)
        heading = self._heading(odometry.stamp + lag) if self._trusted else None
        drift = TUNING.drift / min(max(self._learned, 1) ** 0.5, 10.0)
        return odometry if heading is None else replace(
            odometry, heading=(self._run, heading, drift))

    def learn(self, step: Step, stamp: float) -> None:
        """Take the step that a scan made, of a stamp [s] by the gyroscope's clock."""
        last, self._last = self._last, ((step, stamp) if step.accepted else None)
        if last is None or step.moved is None:
            return
        time = step.stamp - last[0].stamp
        told = [self._raw(at) for at in (last[1], stamp)]
        if told[0] is None or told[1] is None or not 0.0 < time < LONGEST:
            return
        matched = float(step.moved[2])
        turn = told[1] - told[0]
        if not self._known and abs(matched) > LEAST_TURN:
            self._sums += np.sign(matched) * np.array((turn, matched))
            self._find_unit()
        off = (self._factor * turn - matched) / time - self._bias
        self._learned += 1
        weight = max(TUNING.bias, 1.0 / (self._learned + 1.0))
        self._bias += weight * float(np.clip(off, -0.1, 0.1))

    def _compare(self, odometry: Odometry) -> None:
        """Find sign and unit, until matches tell better, by what the wheels turned."""
        last, self._wheels = self._wheels, (odometry, self._raw(odometry.stamp))
        if last is None or last[1] is None or self._wheels[1] is None:
            return
        wheeled = float(between(last[0].pose, odometry.pose)[2])
        self._rough += np.sign(wheeled) * np.array((self._wheels[1] - last[1], wheeled))
        told, turned = self._rough
        if turned < TUNING.wheeled:
            return
        found = [factor for factor in UNITS.values()
                 if ROUGHLY[0] < factor * told / turned < ROUGHLY[1]]
        if found:
            self._factor, self._trusted = found[0], True

    def _find_unit(self) -> None:
        """Find sign and unit once the robot has turned enough."""
        told, matched = self._sums
        if matched < TUNING.turned:
            return
        self._known = True
        found = [(name, factor) for name, factor in UNITS.items()
                 if FITS[0] < factor * told / matched < FITS[1]]
        self._trusted = bool(found)
        if not found:
            self._count('gyro_contradicts', f'an Imu tells {told:.2f} rad where scans show '
                        f'{matched:.2f} rad: it is not used')
        elif found[0][1] != 1.0:
            self._count('gyro_unit', f'the turn rate of an Imu is taken to be in {found[0][0]}')
        if found and found[0][1] != self._factor:
            self._factor, self._bias, self._learned = found[0][1], 0.0, 0
            self._run += 1

    def _heading(self, stamp: float) -> float | None:
        """Return the heading [rad] at a stamp [s], without the bias; None where it is not told."""
        raw = self._raw(stamp)
        if raw is None:
            return None
        self._taken += self._bias * (stamp - self._at) if self._at else 0.0
        self._at = stamp
        return self._factor * raw - self._taken

    def _raw(self, stamp: float) -> float | None:
        """Return the sum [rad] of what was told up to a stamp [s]."""
        if len(self._angles) < 2 or self._angles[0][0] > stamp:
            return None
        last, angle, rate = self._angles[-1]
        if stamp >= last:
            return angle + rate * (stamp - last) if stamp - last <= TUNING.ahead else None
        for before, sum_before, _ in reversed(self._angles):
            if before <= stamp:
                share = (stamp - before) / (last - before)
                return sum_before + share * (angle - sum_before)
            last, angle = before, sum_before
        return None


def by_gyro(step: Array, Q: Array, previous: Odometry, odometry: Odometry
            ) -> tuple[Array, Array]:
    """Return an increment (3,) and its covariance (3, 3), turned as the gyroscope tells."""
    if (previous.heading is None or odometry.heading is None
            or previous.heading[0] != odometry.heading[0]):
        return step, Q
    turn = odometry.heading[1] - previous.heading[1]
    R = np.eye(3)
    R[:2, :2] = rotation(0.5 * (turn - step[2]))
    Q = R @ Q @ R.T
    Q[2, :] = Q[:, 2] = 0.0
    drift = odometry.heading[2] * (odometry.stamp - previous.stamp)
    Q[2, 2] = (TUNING.sigma[0] + TUNING.sigma[1] * abs(turn) + drift) ** 2
    step = R @ step
    step[2] = turn
    return step, Q
