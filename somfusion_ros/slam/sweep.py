# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The time that a laser takes for a scan, checked by the time from scan to scan.

Drivers give `time_increment` in micro- or nanoseconds, give the whole scan's time for each beam,
or the time of another speed of the mirror. No sweep lasts longer than from one scan to the next.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.settings import tuned
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.stamps import StampStream


@dataclass(frozen=True)
class SweepTuning:
    """Tuned numbers of the check of a sweep."""

    longest: float = tuned(
        1.15, 'periods', 'between scans that a sweep may last, as both numbers are rounded',
        'by design')
    slow: float = tuned(
        2.0, 'periods', 'up to which a sweep is taken for that of a slower mirror', 'by design')
    shortest: float = tuned(
        0.2, 'periods', 'that a sweep must last for a mended number to be believed: a field of '
        'view of 72 degrees', 'by design')


TUNING = SweepTuning()
NOT_USED = 'it is not used'
UNITS = (1e-3, 1e-6, 1e-9)   # that drivers forget to convert


class Sweep:
    """Mends the time_increment of one laser's scans."""

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self._stamps = StampStream()

    def mend(self, scan: Scan) -> Scan:
        """Return a scan whose time_increment can be; 0 where nothing tells it."""
        self._stamps.add(scan.stamp, None)
        period, told = self._stamps.period, scan.time_increment
        beams = max(len(scan.ranges), 2)
        usable = bool(np.isfinite(told))
        if usable and (not period or abs(told) * beams <= TUNING.longest * period):
            return scan
        turn = min(abs(scan.angle_increment) * beams / (2.0 * np.pi), 1.0)
        mended, how = _mended(abs(told), beams, period, turn) if usable else (0.0, NOT_USED)
        self._count('scan_time_increment_impossible', f'time_increment = {told:g} s for {beams} '
                    f'beams, but a scan comes every {period:.3f} s: {how}')
        return replace(scan, time_increment=float(np.copysign(mended, told)))


def _mended(told: float, beams: int, period: float, turn: float) -> tuple[float, str]:
    """Return the likeliest time_increment [s] for an absurd one; turn: share of a circle."""
    if told * beams <= TUNING.slow * period:
        return turn * period / beams, 'the mirror is taken to turn once a scan'
    for factor, how in ((1.0 / (beams - 1), 'it is taken for the time of the whole scan'),
                        *((unit, f'it is taken to be in units of {unit:g} s') for unit in UNITS)):
        if TUNING.shortest * period <= factor * told * beams <= TUNING.longest * period:
            return factor * told, how
    return 0.0, NOT_USED
