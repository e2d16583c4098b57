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

import numpy as np
from somfusion_ros.settings import tuned
from somfusion_ros.slam.arrived import Arrived
from somfusion_ros.slam.lateness import Lateness


@dataclass(frozen=True)
class ScanClockTuning:
    """Tuned numbers of the comparison of two clocks."""

    tolerance: float = tuned(
        2.5, 's', 'beside the period of the odometry, by which a scan may be off its usual time '
        'and still belong to the same clock; odometry stalls for up to 1.9 s', 'intel')
    apart: float = tuned(
        1.0, 's', 'beside the period of the odometry, by which a scan may be ahead of its usual '
        'time; from there on it waits until it is known whether a clock was set',
        'benchmarks/slam/clocks.py')
    behind: float = tuned(
        5.0, 's', 'by which it may be behind unless stamps stood still, and is then said to be '
        'late: a slow network makes it so, and the odometry of its time is kept',
        'benchmarks/slam/clocks.py')
    spanned: float = tuned(
        0.4, 's', 'of odometry that scans must come with before a clock is believed to have been '
        'set though no stamp leapt: they may have been held on their way', 'by design')
    old: float = tuned(
        5.0, 's', 'between the stamps of scans that are still of one time', 'by design')
    few: int = tuned(
        5, 'scans', 'that tell how far stamps usually lie from the odometry', 'by design')
    enough: int = tuned(
        15, 'scans', 'after which this is not learned any more, so that it does not follow clocks '
        'that drift apart', 'by design')
    spread: float = tuned(
        0.5, 's', 'by which scans that tell the difference of two clocks may disagree, and late '
        'odometry with the number of messages that came', 'by design')


TUNING = ScanClockTuning()


class ScanClock:
    """
    Places scans in the time of the odometry.

    shift [s] is added to a scan's own stamp, odometry_shift [s] is what was added to those of the
    odometry. Scans wait, undecided, after a leap of either stream, and where they are far from
    their usual time, until it is known what leapt.
    """

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self.shift = self.odometry_shift = 0.0
        self._offsets: list[float] = []        # of the first scans
        self._undecided: list[Arrived] = []
        self._arrivals: deque[Arrived] = deque(maxlen=TUNING.enough)   # since there is doubt
        self._newest: Arrived | None = None    # that came with odometry of its own
        self._doubtful, self._since = False, -np.inf
        self._stood = False      # the stamps of the scans, while the odometry went on
        self._leaps = {'scan': 0.0, 'odometry': 0.0}
        self._missing = 0.0
        self.lateness = Lateness(count)

    @property
    def undecided(self) -> list[Arrived]:
        """Scans that wait until it is known where in time they belong."""
        return self._undecided

    @property
    def _usual(self) -> float:
        """Time [s] by which a placed scan usually lies after the newest odometry."""
        return float(np.median(self._offsets)) if self._is_known else 0.0

    @property
    def _is_known(self) -> bool:
        return len(self._offsets) >= TUNING.few

    def leapt(self, stream: str, leap: float, newest_odometry: float) -> None:
        """Doubt the shift from now on, as the stamps of `scan` or `odometry` leapt [s]."""
        self._leaps[stream] = leap
        self._doubt(newest_odometry)

    def forget(self) -> None:
        """Forget the scans that are undecided, at the beginning of a new map."""
        self._undecided = []
        self._arrivals.clear()

    def add(self, scan: Arrived, odometry_period: float) -> None:
        """
        Add a scan that arrived; `place` returns it once it is known where it belongs.

        odometry_period: usual time [s] between two samples of the odometry
        """
        self._undecided.append(scan)
        self._arrivals.append(scan)
        last = self._newest
        if not np.isfinite(scan.newest_odometry) or last is not None and (
                scan.newest_odometry <= last.newest_odometry or scan.same_time(last)):
            self._stood |= last is not None and scan.same_time(last)
            return    # one of two streams stalls, which says nothing of the clocks
        self._newest = scan
        self.lateness.hear(scan.arrived, scan.messages)
        if self._doubtful or last is None:
            return
        ahead = scan.offset + self.shift
        self.lateness.is_behind(ahead - self._usual)
        if self._is_off(min(ahead, ahead - self._usual), self._usual - ahead, odometry_period):
            if self._is_late(scan, odometry_period):
                return
            self._leaps = {'scan': 0.0, 'odometry': 0.0}
            self._doubt(last.newest_odometry)
            return
        self._stood = False     # the clock went on as it should
        if len(self._offsets) < TUNING.enough:
            self._offsets.append(ahead)

    def _is_off(self, ahead: float, behind: float, odometry_period: float) -> bool:
        """Return whether a scan is so far ahead or behind [s] that a clock may be wrong."""
        if self._is_known and not self._stood and behind > TUNING.behind:
            self._count('scans_late', f'they come {behind:.0f} s later than they did: a slow '
                        'network, or a clock that is too slow')
            return False
        most = TUNING.apart if self._stood else TUNING.behind
        return ahead > TUNING.apart + odometry_period or behind > most + odometry_period

    def _is_late(self, scan: Arrived, odometry_period: float) -> bool:
        """Return whether a scan is ahead of the odometry as that comes late."""
        return self._is_known and self.lateness.explains(
            scan.offset + self.shift - self._usual, TUNING.spread + odometry_period)

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
        return placed

    def missing(self) -> tuple[float, float]:
        """Return, once, since when [s] the odometry so far lacks some time [s]."""
        missing, self._missing = self._missing, 0.0
        return self._since, missing

    def _doubt(self, since: float) -> None:
        """Doubt the shift from now on: what comes with odometry after a stamp [s] tells."""
        self._doubtful, self._since = True, since
        self._arrivals = deque(self._undecided[-TUNING.enough:], TUNING.enough)

    def _decide(self, covered: Callable[[float], bool], odometry_period: float) -> None:
        """Find out by which shift the newest scans belong to the odometry, if that can be told."""
        newest, leap = self._undecided[-1], self._leaps['scan']
        # Where the scans leapt, it is not the odometry that stalls.
        tolerance = odometry_period + (
            TUNING.spread if leap else TUNING.tolerance if self._leaps['odometry'] else
            TUNING.apart)
        if (leap > 0.0 and covered(newest.stamp + self.shift)
                or not np.isfinite(newest.newest_odometry)):
            self._settle(self.shift)      # the laser paused, or there is nothing to compare with
        elif leap and abs(leap - self._leaps['odometry']) < tolerance:
            self._settle(self.odometry_shift)   # both have one clock, and it was set
        elif newest.newest_odometry > self._since:
            missed, shift = min((abs(newest.offset + shift - self._usual), shift)
                                for shift in (self.shift, self.odometry_shift))
            if missed <= tolerance or self._is_late(newest, odometry_period):
                self._settle(shift if missed <= tolerance else self.shift)
            else:
                self._decide_by_arrival(odometry_period)

    def _decide_by_arrival(self, odometry_period: float) -> None:
        """Pair scans and odometry by arrival, once three scans between new odometry agree."""
        least = 0.0 if any(self._leaps.values()) else TUNING.spanned
        last = list(self._arrivals)[-3:]
        for earlier in list(self._arrivals)[-4::-1]:
            if last[-1].newest_odometry - last[0].newest_odometry > least:
                break
            last.insert(0, earlier)
        offsets = [scan.offset for scan in last]
        spanned = last[-1].newest_odometry - last[0].newest_odometry
        together = np.ptp(offsets) < TUNING.spread + odometry_period
        # Scans that were held on their way come in less time than they took.
        held = spanned + odometry_period < 0.5 * (last[-1].stamp - last[0].stamp)
        if len(last) >= 3 and spanned > least and together and not held:
            shift = self._usual - float(np.median(offsets))
            self._pair_by_arrival(shift - self.shift)

    def _pair_by_arrival(self, change: float) -> None:
        """Change the shift by a time [s], or that of the odometry, so that no time goes back."""
        if not self._is_known:
            self._count('scan_clock_differs', 'the scans are stamped by another clock, '
                        f'{-self.shift - change:+.3f} s from that of the odometry; they are '
                        'paired by arrival')
        elif any(self._leaps.values()):
            self._count('scan_clock_set', 'the clock of the scans was set by '
                        f'{-change:+.3f} s against that of the odometry; they are paired by '
                        'arrival')
        else:
            self._count('clocks_apart', f'the scans have come to be {-change:+.3f} s off the '
                        'odometry, though no stamp leapt: a clock stood still, or is too fast '
                        'or too slow; they are paired by arrival')
            if change < 0.0:
                self._missing, change = -change, 0.0
                self.odometry_shift += self._missing
        self._settle(self.shift + change)

    def _settle(self, shift: float) -> None:
        """Believe in a shift; scans of the time before it are left out."""
        if shift != self.shift:
            kept = [scan for scan in self._undecided if abs(
                scan.stamp - self._undecided[-1].stamp) <= TUNING.old]
            for _ in self._undecided[:len(self._undecided) - len(kept)]:
                self._count('scans_before_clock_was_set', 'a scan still has a stamp of the time '
                            'before its clock was set')
            self._undecided = kept
        self.shift, self._doubtful, self._stood = shift, False, False
        self._leaps['scan'] = 0.0
