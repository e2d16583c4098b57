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

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.settings import tuned
from somfusion_ros.slam.motion import Odometry


@dataclass(frozen=True)
class CalibrationTuning:
    """What is believed of an odometry before it is known, and of one step of it."""

    prior_turn: tuple[float, float, float] = tuned(
        (0.10, 0.04, 0.02), 's, share, rad/m',
        'sigmas of lag, turn scale and veer before anything is known',
        'benchmarks/slam/covariance.py, shared logs')
    prior_travel: float = tuned(
        0.04, 'share', 'sigma of the travel scale before anything is known',
        'benchmarks/slam/covariance.py, shared logs')
    turn_noise: tuple[float, float] = tuned(
        (0.015, 0.10), 'rad, share of the turn', 'turn of a step that is not systematic',
        'shared logs')
    travel_noise: tuple[float, float] = tuned(
        (0.015, 0.05), 'm, share of the travel', 'travel of a step that is not systematic',
        'shared logs')
    gate: float = tuned(
        3.0, 'sigmas', 'a step beyond is a slip and teaches nothing', 'by design')
    span: float = tuned(
        2.0, 's', 'steps are summed over this time, so that noise is small beside scales',
        'not measured')
    max_lag: float = tuned(
        0.5, 's', 'clocks that differ by more are not corrected but reported', 'by design')
    turning: float = tuned(
        0.15, 'rad/s', 'below, a turn rate is mostly the noise of matches', 'shared logs')


TUNING = CalibrationTuning()
LAG, SCALES = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0])   # of turning


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
        self.turning, self.P_turning = np.zeros(3), np.diag(TUNING.prior_turn) ** 2
        self.travelling, self.P_travelling = np.zeros(1), np.array([[TUNING.prior_travel ** 2]])
        self._steps: list[_Step] = []

    @property
    def lag(self) -> float:
        """Time [s] to add to a scan's stamp to find the odometry that belongs to it."""
        return float(np.clip(self.turning[0], -TUNING.max_lag, TUNING.max_lag))

    def correct(self, step: Array) -> Array:
        """Return the odometry increment (3,) without its systematic errors."""
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
        if len(self._steps) > 2:
            self._take(self._steps[-3:], LAG)
            if self._steps[-2].end - self._steps[1].start >= TUNING.span:
                self._take(self._steps, SCALES)
                del self._steps[:-2]

    def _take(self, steps: list[_Step], learned: Array) -> None:
        """
        Update the learned coefficients by the steps between the first and the last as one.

        Both odometry and match err at random. What errs on both sides of an equation would pass
        for scale or lag: turn and travel are the mean of the two, over enough time that their
        noise is small beside them, a change of speed is that of the matches, and turns that may
        be noise say nothing.
        """
        inner = steps[1:-1]
        odometry = np.sum([step.odometry for step in inner], axis=0)
        matched = np.sum([step.matched for step in inner], axis=0)
        motion = np.array([0.5 * (step.odometry + step.matched) for step in inner])
        travel, _, turn = motion.sum(0)
        slipping = np.sqrt((motion ** 2).sum(0))   # each step slips by itself
        change = 0.5 * (steps[-1].turn_rate + inner[-1].turn_rate
                        - inner[0].turn_rate - steps[0].turn_rate)
        time = inner[-1].end - inner[0].start
        h = np.array([change if abs(change) > TUNING.turning else 0.0,
                      turn if abs(turn) > TUNING.turning * time else 0.0, travel])
        # The odometry was read with the lag known by now; what remains is the rest of it.
        error = matched[2] - odometry[2] + self.turning[0] * h[0]
        noise = TUNING.turn_noise[0] + TUNING.turn_noise[1] * slipping[2]
        _update(self.turning, self.P_turning, h, error, noise, learned)
        if learned is SCALES:
            own = TUNING.travel_noise[0] + TUNING.travel_noise[1] * slipping[0]
            noise = np.hypot(own, inner[-1].along)
            _update(self.travelling, self.P_travelling, h[2:], matched[0] - odometry[0], noise,
                    np.ones(1))


def _update(x: Array, P: Array, h: Array, z: float, noise: float, learned: Array) -> None:
    """
    Update constant coefficients x (n,), in place, by one z = h . x + noise (Kalman).

    The coefficients that are not learned (0 in learned (n,)) are considered (Schmidt 1966): their
    uncertainty counts, their value stays.
    """
    innovation, variance = z - h @ x, h @ P @ h + noise ** 2
    if innovation ** 2 > TUNING.gate ** 2 * variance:
        return
    K = P @ h / variance * learned
    x += K * innovation
    I_Kh = np.eye(len(x)) - np.outer(K, h)
    P[:] = I_Kh @ P @ I_Kh.T + noise ** 2 * np.outer(K, K)
