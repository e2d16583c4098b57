# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
In which order a laser took the beams of a scan: rising, falling, or all at once, and from where.

Some drivers turn the beams of a clockwise laser round, and leave `time_increment` positive; those
of lasers that see all round may list the beams from another bearing than that where the sweep
began; others undo the robot's motion themselves, or simulate all beams at one moment, and set it
all the same. Deskewing then doubles the distortion that it should undo. While the robot turns, the
data can tell: two scans that were taken at different turn rates fit one another best in the true
order.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from somfusion_ros.geometry import between
from somfusion_ros.settings import tuned
from somfusion_ros.slam.config import AUTO, SlamConfig
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import Match, register
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.slam.sweep_order import in_order, Order, order_of, ORDERS, possible


@dataclass(frozen=True)
class BeamOrderTuning:
    """When two scans tell the order of their beams, and when they have told enough."""

    skew: float = tuned(
        0.02, 'rad', 'by which the robot must have turned more during one scan than during the '
        'other: 20 Hz at 0.4 rad/s', 'test/unit/test_beam_order.py')
    steady: float = tuned(
        0.3, 'share', 'by which the turn rate may differ from that of the scan before',
        'by design')
    near: tuple[float, float] = tuned(
        (1.0, 1.2), 'm, rad', 'within which two scans see the same', 'by design')
    apart: float = tuned(
        0.25, 's', 'between two comparisons, each of which costs three matches', 'by design')
    fits: float = tuned(
        0.6, 'share', 'of a scan that must fit in one of the orders', 'by design')
    enough: int = tuned(
        12, 'comparisons', 'before an order is believed', 'test/unit/test_beam_order.py')
    clear: float = tuned(
        5.0, 'sigmas', 'by which another order must fit better than the one that was told',
        'test/unit/test_beam_order.py')
    distinct: float = tuned(
        3.0, 'sigmas', 'by which the order that is believed must fit better than the others',
        'test/unit/test_beam_order.py')
    better: float = tuned(
        0.05, 'log of a ratio', 'of the misfits, by which another order than the one told must '
        'fit better on average, beside being clear', 'test/unit/test_beam_order.py')
    most: int = tuned(
        200, 'comparisons', 'after which the order that was told is kept', 'by design')


TUNING = BeamOrderTuning()
LEAST = 0.001   # [m] residual of a match, below which smaller is no better
FINER = 0.125, 0.0625     # of a sweep, by which its beginning is moved once it is about known


class Reference:
    """A scan that later ones are compared with."""

    def __init__(self, scan: Scan, odometry: Odometry, max_range: float) -> None:
        self.scan, self.odometry, self._max_range = scan, odometry, max_range
        self._maps: dict[Order, LocalMap] = {}

    def match(self, scan: Scan, odometry: Odometry, order: Order) -> Match:
        """Match a later scan with this one, with the beams of both in an order."""
        if order not in self._maps:
            alone = self._seen(self.scan, self.odometry, order)
            self._maps[order] = LocalMap.of_views([alone], [np.zeros(3)])
        return register(self._seen(scan, odometry, order), self._maps[order],
                        between(self.odometry.pose, odometry.pose))

    def _seen(self, scan: Scan, odometry: Odometry, order: Order) -> Cloud:
        return cloud(in_order(scan, order), self._max_range, odometry.twist)


class Compared(NamedTuple):
    """Two scans that were compared."""

    reference: Reference
    scan: Scan
    odometry: Odometry

    def misfit(self, order: Order) -> float:
        """Return how badly the two fit one another in an order."""
        return _misfit(self.reference.match(self.scan, self.odometry, order))


class BeamOrder:
    """
    Gives the scans of one laser the order that their beams have in time.

    Parameters
    ----------
    count : called with the name of each fault, and its reason

    """

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self._order: Order | None = None          # by the data, once it is known
        self._previous: Odometry | None = None
        self._reference: Reference | None = None
        self._told: list[dict[Order, float]] = []   # log of the misfit, by order
        self._compared: deque[Compared] = deque(maxlen=TUNING.enough)
        self._last = -np.inf

    @property
    def decided(self) -> bool:
        """Whether nothing more is to be learned."""
        return self._order is not None or len(self._told) >= TUNING.most

    def mend(self, scan: Scan, odometry: Odometry, config: SlamConfig) -> Scan:
        """Return the scan with its beams in the order in which they were taken."""
        if scan.beam_time == 0.0 or scan.fault() or odometry.fault():
            return scan
        if config.beam_order != AUTO:
            return in_order(scan, ORDERS[config.beam_order])
        if not self.decided:
            self._learn(scan, odometry, config.max_laser_range)
        if self._order is None:
            return scan
        mended = in_order(scan, self._order)
        if order_of(mended) != order_of(scan):
            self._count('scan_beam_order', 'while the robot turns, scans fit one another best '
                        f'with the beams in {self._order.words()}: they are taken so')
        return mended

    def _learn(self, scan: Scan, odometry: Odometry, max_range: float) -> None:
        """Compare a scan with an earlier one, if the two can tell."""
        previous, self._previous = self._previous, odometry
        if previous is None or not _steady(previous, odometry):
            return
        reference = self._reference
        if reference is None or not _near(reference.odometry, odometry):
            self._reference = Reference(scan, odometry, max_range)
            return
        skew = (odometry.twist[2] - reference.odometry.twist[2]) * scan.sweep
        if abs(skew) < TUNING.skew or abs(odometry.stamp - self._last) < TUNING.apart:
            return
        self._last = odometry.stamp
        found = {order: reference.match(scan, odometry, order)
                 for order in possible(reference.scan)}
        if max(match.inlier_ratio for match in found.values()) < TUNING.fits:
            return
        if self._told and found.keys() != self._told[0].keys():   # it sees another angle now
            self._told.clear()
        self._told.append({order: _misfit(match) for order, match in found.items()})
        self._compared.append(Compared(reference, scan, odometry))
        self._decide(order_of(scan))

    def _decide(self, usual: Order) -> None:
        """Believe an order once it is clear; another than the usual one must fit much better."""
        if len(self._told) < TUNING.enough:
            return
        told = {order: np.array([one[order] for one in self._told]) for order in self._told[0]}
        best = min(told, key=lambda order: float(told[order].mean()))
        for order, misfits in told.items():
            if order == best or order != usual and order.resembles(best):
                continue
            gain = misfits - told[best]
            sigma = float(gain.std()) / np.sqrt(len(gain)) + 1e-9
            if gain.mean() < (max(TUNING.better, TUNING.clear * sigma) if order == usual else
                              TUNING.distinct * sigma):
                return
        self._order = best if best == usual else self._refined(best)
        self._reference = None
        self._compared.clear()

    def _refined(self, order: Order) -> Order:
        """Return an order with the beginning of the sweep as the scans that were compared fit."""
        for step in FINER if order.shifted(0.25) in self._told[0] else ():
            told = {near: np.mean([one.misfit(near) for one in self._compared])
                    for near in (order, order.shifted(-step), order.shifted(step))}
            best = min(told, key=lambda near: float(told[near]))
            order = best if told[best] < told[order] - TUNING.better else order
        return order


def _misfit(match: Match) -> float:
    """Return the log of the points' mean squared distance, more where fewer of them fit."""
    if match.inlier_ratio == 0.0:
        return 0.0
    return float(np.log(match.residual ** 2 + LEAST ** 2) - 2.0 * np.log(match.inlier_ratio))


def _steady(before: Odometry, now: Odometry) -> bool:
    """Tell whether the robot goes on turning as it did at the scan before."""
    rate, change = float(now.twist[2]), float(now.twist[2] - before.twist[2])
    return abs(change) <= TUNING.steady * abs(rate) + 0.02


def _near(one: Odometry, other: Odometry) -> bool:
    """Tell whether two scans were taken where they see the same."""
    x, y, turn = between(one.pose, other.pose)
    return bool(np.hypot(x, y) < TUNING.near[0] and abs(turn) < TUNING.near[1])
