# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The order of the beams of every laser, and the first scans of a map until it is known.

What was drawn before an order is known to be another one bends the whole map: the first scans are
kept, so that they can be gone through again.
"""

from collections.abc import Callable
from typing import NamedTuple

from somfusion_ros.slam.beam_order import BeamOrder
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.config import AUTO, SlamConfig
from somfusion_ros.slam.laser import MOST_LASERS
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.sweep_order import order_of

MOST_EARLY = 600        # scans that are kept until the order is known: a minute at 10 Hz
FEW = 50                # scans without any time_increment, after which none is waited for
MOST_BEAMS = 1000000    # of all of them
APART = 0.08            # [s] least time between two scans of one laser that are kept


class Early(NamedTuple):
    """A scan of the beginning, as it came, with the odometry and the other robots then."""

    scan: Scan
    odometry: Odometry
    bodies: Bodies


class BeamOrders:
    """Gives the scans of all lasers of one robot the order that their beams have in time."""

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self._orders: dict[str, BeamOrder] = {}    # by laser
        self._early: list[Early] | None = []       # None once they are too many
        self._again: SlamConfig | None = None      # with which the early ones are to be mended
        self._beams = 0
        self._kept: dict[str, float] = {}          # stamp [s] of the newest early one, by laser

    def forget(self) -> None:
        """Forget the first scans, as the map does not begin with them."""
        self._early = None

    def mend(self, early: Early, config: SlamConfig) -> Scan:
        """Return the scan with the beams in the order in which they were taken."""
        scan = early.scan
        if scan.laser not in self._orders and len(self._orders) >= MOST_LASERS:
            return scan
        order = self._orders.setdefault(scan.laser, BeamOrder(self._count))
        known = order.decided
        mended = order.mend(scan, early.odometry, config)
        if order.decided and not known and order_of(mended) != order_of(scan):
            self._again = config
        else:
            self._keep(early, config)
        return mended

    def again(self) -> list[Early]:
        """Return the first scans in their order, once, where they were gone through in another."""
        config, self._again = self._again, None
        if config is None:
            return []
        return [early._replace(scan=self._orders[early.scan.laser].mend(
            early.scan, early.odometry, config)) for early in self._early or []]

    def _keep(self, early: Early, config: SlamConfig) -> None:
        """Keep one of the first scans, while they are few and the order is not known."""
        laser, stamp = early.scan.laser, early.scan.stamp
        if self._early is None or abs(stamp - self._kept.get(laser, -1e9)) < APART:
            return
        self._early.append(early)
        self._beams += len(early.scan.ranges)
        self._kept[laser] = stamp
        untimed = len(self._early) == FEW and not any(e.scan.beam_time for e in self._early)
        if (len(self._early) > MOST_EARLY or self._beams > MOST_BEAMS or untimed
                or config.beam_order != AUTO
                or all(order.decided for order in self._orders.values())):
            self._early = None
