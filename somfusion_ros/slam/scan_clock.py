# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The clock of the scans against that of the odometry.

Scans and odometry arrive side by side, so that a scan's stamp lies near that of the newest
odometry. Where it does not, one of two clocks was set, or the two were never the same: then the
order of arrival pairs them, and the lag that remains is learned from the motion.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class ScanClockTuning:
    """Tuned numbers of the comparison of two clocks."""

    tolerance: float = tuned(
        2.5, 's', 'beside the period of the odometry, by which a scan may be off its usual time '
        'and still belong to the same clock; odometry stalls for up to 1.9 s', 'intel')
    other_clock: float = tuned(
        5.0, 's', 'between the first scans and the odometry that makes them two clocks; sensors '
        'may be switched on one after the other', 'by design')
    first_scans: int = tuned(
        10, 'scans', 'that must agree on it', 'by design')
    few: int = tuned(
        5, 'scans', 'that tell how far stamps usually lie from the odometry', 'by design')
    spread: float = tuned(
        0.5, 's', 'by which scans that tell the difference of two clocks may disagree',
        'by design')


TUNING = ScanClockTuning()


class Arrived(NamedTuple):
    """A scan as it arrived: its own stamp [s], that of the newest odometry then, and the scan."""

    stamp: float
    newest_odometry: float
    item: Any

    @property
    def offset(self) -> float:
        """Stamp against that of the newest odometry [s]."""
        return self.stamp - self.newest_odometry


class ScanClock:
    """
    Places scans in the time of the odometry.

    shift [s] is added to a scan's own stamp, odometry_shift [s] is what was added to those of the
    odometry. Scans wait, undecided, after a leap of either stream until it is known what leapt.
    """

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self.shift = self.odometry_shift = 0.0
        self._first: list[Arrived] | None = []
        self._usual: deque[float] = deque(maxlen=15)
        self._undecided: list[Arrived] = []
        self._doubtful, self._since = False, -np.inf
        self._leaps = {'scan': 0.0, 'odometry': 0.0}

    @property
    def undecided(self) -> list[Arrived]:
        """Scans that wait until it is known where in time they belong."""
        return self._undecided

    def leapt(self, stream: str, leap: float, newest_odometry: float) -> None:
        """Doubt the shift from now on, as the stamps of `scan` or `odometry` leapt [s]."""
        self._doubtful, self._leaps[stream], self._since = True, leap, newest_odometry

    def forget(self) -> None:
        """Forget the scans that are undecided, at the beginning of a new map."""
        self._undecided = []

    def add(self, scan: Arrived) -> None:
        """Add a scan that arrived; `place` returns it once it is known where it belongs."""
        self._undecided.append(scan)
        if self._first is not None and np.isfinite(scan.newest_odometry):
            self._first.append(scan)
            if len(self._first) == TUNING.first_scans:
                self._compare_first(self._first)
                self._first = None

    def place(self, covered: Callable[[float], bool], odometry_period: float) -> list[Arrived]:
        """
        Return the scans that can be placed now, in order.

        Parameters
        ----------
        covered : whether the odometry covers a stamp [s] already
        odometry_period : usual time [s] between two samples of the odometry

        """
        if self._doubtful and self._undecided:
            self._decide(covered, odometry_period)
        if self._doubtful:
            return []
        placed, self._undecided = self._undecided, []
        self._usual += [scan.offset + self.shift for scan in placed
                        if np.isfinite(scan.newest_odometry)]
        return placed

    def _decide(self, covered: Callable[[float], bool], odometry_period: float) -> None:
        """Find out by which shift the newest scans belong to the odometry, if that can be told."""
        newest, leap = self._undecided[-1], self._leaps['scan']
        # Where the scans leapt, it is not the odometry that stalls.
        tolerance = odometry_period + (TUNING.spread if leap else TUNING.tolerance)
        if (leap > 0.0 and covered(newest.stamp + self.shift)
                or not np.isfinite(newest.newest_odometry)):
            self._settle(self.shift)      # the laser paused, or there is nothing to compare with
        elif leap and abs(leap - self._leaps['odometry']) < tolerance:
            self._settle(self.odometry_shift)   # both have one clock, and it was set
        elif newest.newest_odometry > self._since:
            known = len(self._usual) >= TUNING.few
            usual = float(np.median(self._usual)) if known else 0.0
            missed, shift = min((abs(newest.offset + shift - usual), shift)
                                for shift in (self.shift, self.odometry_shift))
            if missed <= tolerance:
                self._settle(shift)
            else:
                self._decide_by_arrival(usual)

    def _decide_by_arrival(self, usual: float) -> None:
        """Pair scans and odometry by arrival, once three scans between new odometry agree."""
        last = self._undecided[-3:]
        offsets = [scan.offset for scan in last]
        if (len(last) == 3 and last[-1].newest_odometry - last[0].newest_odometry > 0.0
                and np.ptp(offsets) < TUNING.spread):
            shift = usual - float(np.median(offsets))
            self._count('scan_clock_set', 'the clock of the scans was set by '
                        f'{self.shift - shift:+.3f} s against that of the odometry; they are '
                        'paired by arrival')
            self._settle(shift)

    def _compare_first(self, first: list[Arrived]) -> None:
        """Notice that the scans are stamped by another clock from the beginning."""
        offsets = np.array([scan.offset for scan in first])
        if (np.abs(offsets).min() > TUNING.other_clock and np.ptp(offsets) < TUNING.spread
                and first[-1].newest_odometry > first[0].newest_odometry):
            shift = -float(np.median(offsets))
            self._count('scan_clock_differs', 'the scans are stamped by another clock, '
                        f'{-shift:+.3f} s from that of the odometry; they are paired by arrival')
            self._settle(shift)

    def _settle(self, shift: float) -> None:
        """Believe in a shift; scans of the time before it are left out."""
        if shift != self.shift:
            kept = [scan for scan in self._undecided if abs(
                scan.stamp - self._undecided[-1].stamp) <= TUNING.other_clock]
            for _ in self._undecided[:len(self._undecided) - len(kept)]:
                self._count('scans_before_clock_was_set', 'a scan still has a stamp of the time '
                            'before its clock was set')
            self._undecided = kept
        self.shift, self._doubtful = shift, False
        self._leaps['scan'] = 0.0
