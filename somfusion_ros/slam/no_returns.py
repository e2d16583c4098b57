# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the beams of a laser mean that brought no return.

By REP-117 `inf` says that nothing stands within `range_max`. Many lasers say it of every beam that
failed, see far less than their `range_max`, or give a number just under it. So an `inf` frees
space only as far as this laser has been seen to see; where single beams are missing amid
surfaces, only as far as its neighbours returned; and a number that whole sectors repeat just
under `range_max` is none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned
from somfusion_ros.slam.scan import Scan


@dataclass(frozen=True)
class NoReturnTuning:
    """Tuned numbers of what beams without a return mean."""

    narrow: float = tuned(
        0.4, 'm', 'widest gap in a surface in which missing beams are taken to have failed: a '
        'door is wider', 'test/unit/test_no_returns.py')
    beams: float = tuned(
        3.0, 'beams', 'that a gap may span at any range, as beams lie far apart there',
        'test/unit/test_no_returns.py')
    failed: float = tuned(
        0.015, 'share', 'of beams amid surfaces that failed, from which on no `inf` of this laser '
        'is believed; larger believes lasers that lose 3 %', 'test/unit/test_no_returns.py')
    memory: float = tuned(
        0.98, 'share', 'of the evidence of failed beams that each scan keeps: 50 scans',
        'by design')
    farthest: int = tuned(
        20, 'returns', 'beyond a range that show that the laser sees so far', 'by design')
    bin_width: float = tuned(
        0.1, 'm', 'edge of the bins in which ranges are counted', 'by design')
    top: float = tuned(
        0.98, 'share', 'of range_max above which a range may be no measurement',
        'test/unit/test_no_returns.py')
    sector: float = tuned(
        0.6, 'rad', 'of beams above it, in one scan, that no wall makes: a straight wall lies '
        'within 2 % of its distance over 0.4 rad', 'by design')
    below: float = tuned(
        0.9, 'share', 'of range_max from which ranges up to `top` are compared with those above: '
        'four times the room', 'by design')
    pile: float = tuned(
        40.0, 'returns', 'of 50 scans, by which those above `top` outnumber those below it, four '
        'times as many as walls leave there; at most 3 times on mines_exp1 and mines_exp2',
        'mines_exp1, mines_exp2')
    settled: int = tuned(
        20, 'scans', 'before which a single range just under range_max is not believed, as too '
        'few were seen to tell', 'test/unit/test_no_returns.py')
    direction: float = tuned(
        0.0524, 'rad', 'of the laser within which beams are one, where it is asked whether they '
        'ever returned: 3 degrees', 'by design')


TUNING = NoReturnTuning()


class NoReturns:
    """Learns from the scans of one laser what its beams without a return mean."""

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self._bins = np.zeros(0, np.int64)     # returns by range, see `bin_width`
        self._failed = self._met = 0.0         # beams amid surfaces: missing ones, and all
        self._filled = 0.0                     # scans of late with whole sectors at range_max
        self._top = self._below = 0.0          # returns of late just under range_max, and below
        self._sees = np.zeros(round(2.0 * np.pi / TUNING.direction), bool)   # by direction
        self._scans = 0

    def mend(self, scan: Scan) -> Scan:
        """Return a scan without numbers that are none, and with what its open beams may free."""
        ranges = np.asarray(scan.ranges, dtype=float)
        filled = self._fillings(scan, ranges)
        if filled.any():
            ranges = np.where(filled, np.inf, ranges)
        with np.errstate(invalid='ignore'):
            hit = (ranges >= max(scan.range_min, 1e-3)) & (ranges < scan.range_max)
            missing = np.isposinf(ranges)
        self._learn_range(ranges[hit])
        if not missing.any():
            return scan
        reach = self._reach(scan, ranges, hit, missing)
        return replace(scan, ranges=ranges, open_reach=reach)

    def _reach(self, scan: Scan, ranges: Array, hit: NDArray[np.bool_],
               missing: NDArray[np.bool_]) -> Array:
        """Return the range (B,) [m] up to which each beam that is missing frees space."""
        before, after = _neighbours(hit)
        bounded = (before >= 0) & (after >= 0)
        returns = np.where(hit, ranges, 0.0)
        one, other = returns[before], returns[after]
        nearer, farther = np.minimum(one, other), np.maximum(one, other)
        span = after - before
        gap = nearer * abs(scan.angle_increment) * span
        surface = farther <= 1.2 * nearer + 0.1
        amid = missing & bounded & surface & ((gap < TUNING.narrow) | (span <= TUNING.beams))
        self._learn_failures(int(np.count_nonzero(amid)), int(np.count_nonzero(hit)))
        near = np.where(bounded, nearer, np.where(before >= 0, one, np.where(
            after >= 0, other, 0.0)))
        seen = self._farthest()
        reach = np.where(amid | (not self._believed()), np.minimum(near, seen), seen)
        reach[self._blind(scan, hit) & ~amid] = 0.0
        return np.where(missing, reach, 0.0)

    def _believed(self) -> bool:
        """Tell whether `inf` is a measurement of this laser."""
        believed = self._failed <= TUNING.failed * self._met
        if not believed:
            self._count('scans_with_failed_beams',
                        f'{100.0 * self._failed / self._met:.0f} % of the beams amid surfaces '
                        'fail: beams without a return free no more space than their neighbours')
        return believed

    def _learn_failures(self, failed: int, returned: int) -> None:
        """Count beams that failed amid surfaces, and those that returned."""
        self._failed = TUNING.memory * self._failed + failed
        self._met = TUNING.memory * self._met + failed + returned

    def _learn_range(self, returns: Array) -> None:
        """Count returns (N,) [m] by range."""
        if not len(returns):
            return
        index = np.minimum(returns / TUNING.bin_width, 10000.0).astype(np.intp)
        counts = np.bincount(index, minlength=len(self._bins))
        counts[:len(self._bins)] += self._bins
        self._bins = counts

    def _farthest(self) -> float:
        """Return the range [m] that enough returns came from."""
        beyond = self._bins[::-1].cumsum()
        enough = np.flatnonzero(beyond >= TUNING.farthest)
        return (len(self._bins) - float(enough[0])) * TUNING.bin_width if len(enough) else 0.0

    def _fillings(self, scan: Scan, ranges: Array) -> NDArray[np.bool_]:
        """Mask (B,) of the beams whose range just under range_max is none."""
        with np.errstate(invalid='ignore'):
            top = (ranges >= TUNING.top * scan.range_max) & (ranges < scan.range_max)
            below = (ranges >= TUNING.below * scan.range_max) & (ranges < scan.range_max) & ~top
        count = np.count_nonzero(top)
        self._top = TUNING.memory * self._top + count
        self._below = TUNING.memory * self._below + np.count_nonzero(below)
        sector = count * abs(scan.angle_increment) > TUNING.sector and count >= 5
        self._filled = TUNING.memory * self._filled + sector
        self._scans += 1
        if self._filled < 0.5 and self._top < self._below + TUNING.pile:
            return top & _lone(top) & (self._scans <= TUNING.settled)
        self._count('scans_filled_to_range_max', 'many ranges lie just under range_max = '
                    f'{scan.range_max:g} m: they are taken for no return')
        return top

    def _blind(self, scan: Scan, hit: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask (B,) of the beams in whose direction this laser has never seen anything."""
        angles = scan.angle_min + scan.angle_increment * np.arange(len(hit))
        directions = np.floor(angles / TUNING.direction).astype(np.intp) % len(self._sees)
        self._sees[directions[hit]] = True
        blind: NDArray[np.bool_] = ~self._sees[directions]
        return blind


def _lone(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (B,) of the beams of which neither neighbour is in a mask."""
    padded = np.pad(mask, 1)
    alone: NDArray[np.bool_] = ~(padded[:-2] | padded[2:])
    return alone


def _neighbours(hit: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the nearest beams (B,) with a return before and after each beam; -1 if none."""
    beams = np.arange(len(hit))
    before = np.maximum.accumulate(np.where(hit, beams, -1))
    after = np.minimum.accumulate(np.where(hit, beams, len(hit))[::-1])[::-1]
    return before, np.where(after == len(hit), -1, after)
