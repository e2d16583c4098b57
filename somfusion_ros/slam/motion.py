# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry: interpolation by stamp, and the noise of an increment."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, hypot, sin

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import Array, between, compose, wrap

HISTORY = 20000  # odometry samples kept for scans that come late
REACH = 0.5  # [s] that odometry reaches beyond its newest sample by its twist, if none comes
TWIST_SPAN = 0.2  # [s] least time over which a twist is measured: samples may arrive in bursts


@dataclass(frozen=True, eq=False)
class Odometry:
    """
    The robot's odometry at one moment.

    stamp [s], pose T_odom_base (3,), twist (3,) [m/s, m/s, rad/s] in the base frame, and, where
    it comes from encoders, slip (3,): the covariance of travel and turn that the wheels' slip
    has added up to, var(travel) [m^2], cov(travel, turn) [m rad], var(turn) [rad^2]; where nobody
    measured the motion, slip (4,) with var(across) [m^2] last, and measured is False. heading
    by a gyroscope: number of its run, angle [rad], sigma of its drift [rad/s]. before: what the
    odometry of the scan before turned out to be, where that had been extrapolated.
    """

    stamp: float
    pose: Array
    twist: Array
    slip: Array | None = None
    measured: bool = True
    heading: tuple[int, float, float] | None = None
    before: 'Odometry | None' = None

    def slip_since(self, previous: 'Odometry') -> Array | None:
        """Return the slip (3,) since an earlier moment; None where it is not known of both."""
        if self.slip is None or previous.slip is None or self.slip[2] < previous.slip[2]:
            return None
        return self.slip - previous.slip

    def corrected(self, told: 'Odometry | None') -> 'Odometry | None':
        """Return the odometry told with the scan before, as it turned out to be."""
        if told is None or self.before is None or self.before.stamp != told.stamp:
            return told
        return replace(self.before, heading=told.heading)

    def fault(self) -> str:
        """Name what makes the odometry unusable, '' if nothing does."""
        usable = np.isfinite([self.stamp, *self.pose, *self.twist]).all()
        return '' if usable else 'odometry_not_finite'


@dataclass(frozen=True)
class MotionNoise:
    """
    Standard deviations of odometry after one metre or one radian, and a floor of an increment.

    along and across the travel [m], heading by travel [rad], heading by turn [rad]; the variance
    grows with the way, so that it does not matter in how many increments it is read. The floor
    [m], [rad] is that of the reading itself.
    """

    along: float = 0.03
    across: float = 0.02
    heading: float = 0.04
    turn: float = 0.10
    floor: float = 0.005
    floor_heading: float = 0.003


class OdometryBuffer:
    """
    Odometry samples by stamp; repeated, backward and not finite ones are counted, not kept.

    lag [s] is added to a stamp that is looked up, where the clocks of laser and wheels differ.
    """

    def __init__(self, count: Callable[[str], None] = lambda name: None) -> None:
        self._samples: deque[tuple[float, Array, Array | None]] = deque(maxlen=HISTORY)
        self._stamps: deque[float] = deque(maxlen=HISTORY)
        self._count = count
        self.lag = 0.0

    @property
    def latest(self) -> float | None:
        """Stamp [s] of the newest sample."""
        return self._stamps[-1] if self._stamps else None

    @property
    def stamps(self) -> Array:
        """Stamps (n,) [s] of what is kept."""
        return np.array(self._stamps)

    def clear(self) -> None:
        """Forget everything, after a jump in time."""
        self._samples.clear()
        self._stamps.clear()

    def add(self, stamp: float, pose: ArrayLike, slip: ArrayLike | None = None) -> bool:
        """Keep T_odom_base (3,) at a stamp [s]; return whether it could be used."""
        pose = np.array(pose, dtype=float)   # a copy: the caller may use its array again
        if pose.shape != (3,) or not np.isfinite(pose).all() or not np.isfinite(stamp):
            self._count('odometry_not_finite')
            return False
        if self._stamps and stamp <= self._stamps[-1]:
            self._count('odometry_stamps_repeated' if stamp == self._stamps[-1]
                        else 'odometry_stamps_backward')
            return False
        self._samples.append((stamp, pose, None if slip is None else np.array(slip, float)))
        self._stamps.append(stamp)
        return True

    def delay(self, since: float, by: float) -> None:
        """Let the samples after a stamp [s] be of a later time [s]."""
        if by > 0.0:
            later = [sample for sample in self._samples if sample[0] > since]
            for _ in later:
                self._samples.pop()
                self._stamps.pop()
            for stamp, pose, slip in later:
                self.add(stamp + by, pose, slip)

    def at(self, stamp: float, sweep: float = 0.0) -> Odometry | None:
        """
        Return the odometry at a stamp [s] plus lag; None unless samples cover it and the sweep.

        The twist is the mean over the sweep that begins there, or about the stamp without one.
        The pose is the nearest sample, moved along the mean twist around it. A log's stamps can be
        times of arrival, in bursts; a sample recorded with the scan still tells where that scan
        was taken, though its neighbours' stamps are wrong.
        """
        if not self.covers(stamp, sweep):
            return None
        if sweep > 0.0:
            start, end = self.at(stamp), self.at(stamp + sweep)
            if start is None or end is None:
                return None
            return replace(start, twist=mean_twist(between(start.pose, end.pose), sweep))
        after = max(1, bisect_left(self._stamps, stamp))
        near = after - (stamp - self._stamps[after - 1] < self._stamps[after] - stamp)
        t, pose, slip = self._samples[near]
        ahead = stamp + self.lag - t
        twist, growth = self._rates(near, ahead)
        return Odometry(stamp, compose(pose, swept(twist, ahead)), twist,
                        None if growth is None or slip is None else slip + growth * ahead)

    def extrapolated(self, stamp: float) -> Odometry | None:
        """Return odometry a little after the newest sample, by its twist; None if too far."""
        last = (None if self.latest is None else self.at(self.latest - max(self.lag, 0.0)))
        if last is None or not 0.0 <= stamp - last.stamp <= REACH:
            return None
        step = swept(last.twist, stamp - last.stamp)
        return Odometry(stamp, compose(last.pose, step), last.twist, last.slip)

    def covers(self, stamp: float, sweep: float = 0.0) -> bool:
        """Tell whether the samples reach from before the stamp to after it, lag and sweep [s]."""
        return (len(self._stamps) > 1 and self._stamps[0] <= stamp
                and stamp + sweep <= self._stamps[-1] - max(self.lag, 0.0))

    def passed(self, stamp: float) -> bool:
        """Tell whether the samples begin after the stamp, so that they never cover it."""
        return bool(self._stamps) and stamp < self._stamps[0]

    def _rates(self, near: int, ahead: float) -> tuple[Array, Array | None]:
        """Return mean twist (3,) and growth of slip (3,) from sample `near` to `ahead` [s]."""
        target, last = self._stamps[near] + ahead, near
        while last == 0 or self._stamps[last] < target:
            last += 1
        first = min(near, last - 1)
        while first > 0 and (self._stamps[first] > target
                             or self._stamps[last] - self._stamps[first] < TWIST_SPAN):
            first -= 1
        (t0, pose0, slip0), (t1, pose1, slip1) = self._samples[first], self._samples[last]
        dt = t1 - t0
        growth = None if slip0 is None or slip1 is None else (slip1 - slip0) / dt
        return mean_twist(between(pose0, pose1), dt), growth


def swept(twist: Array, time: float) -> Array:
    """Return the pose (3,) after a time [s] at constant twist (3,): the chord of an arc."""
    vx, vy, rate = twist.tolist()
    half = 0.5 * rate * time
    c, s, chord = cos(half), sin(half), time * _chord(half)
    return np.array((chord * (c * vx - s * vy), chord * (s * vx + c * vy), time * rate))


def mean_twist(step: Array, time: float) -> Array:
    """Return the constant twist (3,) that sweeps a step (3,) in a time [s]."""
    x, y, theta = step.tolist()
    half = 0.5 * float(wrap(theta))
    c, s, chord = cos(half), sin(half), time * _chord(half)
    return np.array(((c * x + s * y) / chord, (c * y - s * x) / chord, 2.0 * half / time))


def arc(travel: float, turn: float) -> Array:
    """Return pose (3,) after driving `travel` [m] on a circle while turning by `turn` [rad]."""
    half = 0.5 * turn
    chord = travel * _chord(half)
    return np.array((chord * cos(half), chord * sin(half), turn))


def _chord(half: float) -> float:
    """Return the length of a chord over that of its arc, for half the angle [rad]."""
    return sin(half) / half if half else 1.0


def increment_covariance(step: Array, noise: MotionNoise, slip: Array | None = None) -> Array:
    """
    Return the covariance (3, 3) of an odometry increment.

    It grows with travel and turn, or, where both wheels are known, by the slip (3,) that they
    had meanwhile, or (4,) where nobody measured the motion. A turn that is wrong shows in part
    across the travel.
    """
    x, y, theta = step.tolist()
    travel, turn = hypot(x, y), float(wrap(theta))
    floor, floor_heading = noise.floor ** 2, noise.floor_heading ** 2
    across = noise.across ** 2 * travel + floor
    if slip is None:
        along = noise.along ** 2 * travel + floor
        heading = noise.heading ** 2 * travel + noise.turn ** 2 * abs(turn) + floor_heading
        P = np.diag((along, across, heading))
        c, s = (x / travel, y / travel) if travel > 1e-9 else (1.0, 0.0)
    else:
        along, both, heading, *sideways = slip.tolist()
        across += sum(sideways)
        P = np.diag((along + floor, across, heading + floor_heading))
        P[0, 2] = P[2, 0] = both
        c, s = cos(0.5 * turn), sin(0.5 * turn)
    T = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    return np.asarray(T @ P @ T.T, dtype=float)
