# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One laser, as its scans show it to be: what is wrong with them in the same way is mended."""

from collections.abc import Callable

import numpy as np
from somfusion_ros.slam.no_returns import NoReturns
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.sweep import Sweep

FAULTS = {'scan_not_finite': 'a number is not finite', 'scan_empty': 'it has fewer than 2 ranges',
          'scan_geometry_invalid': 'beams are 0 rad apart, or range_max is not over range_min'}
FARTHEST = 300.0   # [m] that a laser of a robot may see
MOST_LASERS = 16   # of one robot, whose habits are learned


class Laser:
    """Mends the scans of one laser by what all of them show, and counts what is odd."""

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self._no_returns, self._sweep = NoReturns(count), Sweep(count)

    def mend(self, scan: Scan) -> Scan:
        """Return the scan as it was meant."""
        if scan.odd:
            self._count('scan_angles_contradict', scan.odd)
        fault = scan.fault()
        if fault:
            self._count(fault, fault_words(scan))
            return scan
        scan = self._sweep.mend(self._no_returns.mend(scan))
        words = emptiness(scan)
        if words:
            self._count('scans_without_returns', words)
        return scan


def fault_words(scan: Scan) -> str:
    """Return what makes a scan with a fault unusable."""
    return (f'{FAULTS[scan.fault()]}: {np.size(scan.ranges)} ranges, angle_min '
            f'{scan.angle_min:g}, angle_increment {scan.angle_increment:g}, range_min '
            f'{scan.range_min:g}, range_max {scan.range_max:g}, stamp {scan.stamp:g}')


def emptiness(scan: Scan) -> str:
    """Return why no beam of a scan can be used; '' where one can."""
    ranges = np.asarray(scan.ranges, dtype=float)
    with np.errstate(invalid='ignore'):
        kinds = {
            'a usable range': ((ranges >= max(scan.range_min, 1e-3))
                               & (ranges < min(scan.range_max, FARTHEST))),
            f'over {FARTHEST:g} m': (ranges >= FARTHEST) & (ranges < scan.range_max),
            'inf': np.isposinf(ranges), 'NaN': np.isnan(ranges), '0': ranges == 0.0,
            f'over range_max = {scan.range_max:g} m': (
                np.isfinite(ranges) & (ranges >= scan.range_max)),
            f'under range_min = {scan.range_min:g} m': (ranges < scan.range_min)
            & (ranges != 0.0)}
    if kinds.pop('a usable range').any():
        return ''
    told = ', '.join(f'{np.count_nonzero(mask)} {kind}' for kind, mask in kinds.items()
                     if mask.any())
    finite = ranges[np.isfinite(ranges)]
    hint = ' (in millimetres?)' if len(finite) and np.median(finite) > 100.0 else ''
    return f'none of {len(ranges)} beams can be used: {told}{hint}'
