# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""In which order the beams of a scan were taken, and where the sweep began."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from somfusion_ros.slam.scan import Scan

ROUND = np.radians(350.0)   # from which a scan sees all round, and may begin anywhere


class Order(NamedTuple):
    """The sign of time_increment, and the share of the listed beams where the sweep begins."""

    sign: float
    begins: float = 0.0

    def words(self) -> str:
        """Say it."""
        if self.sign == 0.0:
            return 'no order of time, all at once'
        return (f'{"rising" if self.sign > 0.0 else "falling"} order of time'
                + (f', from {self.begins:.0%} of them on' if self.begins else ''))

    def shifted(self, share: float) -> 'Order':
        """Return it with a sweep that begins a share of the beams later."""
        return self._replace(begins=(self.begins + share) % 1.0)

    def resembles(self, other: 'Order') -> bool:
        """Tell whether a sweep that begins between the two would look like both."""
        apart = abs(self.begins - other.begins)
        return self.sign == other.sign != 0.0 and min(apart, 1.0 - apart) <= 0.25


RISING, FALLING, AT_ONCE = Order(1.0), Order(-1.0), Order(0.0)
ORDERS = {'rising': RISING, 'falling': FALLING, 'at_once': AT_ONCE}
ALL_ROUND = [Order(order.sign, begins) for order in (RISING, FALLING)
             for begins in (0.0, 0.25, 0.5, 0.75)]


def in_order(scan: Scan, order: Order) -> Scan:
    """Return a scan whose beams were taken in an order."""
    return replace(scan, time_increment=order.sign * abs(scan.time_increment),
                   begins=order.begins)


def order_of(scan: Scan) -> Order:
    """Return the order in which the beams of a scan are taken to be."""
    return Order(float(np.sign(scan.beam_time)), scan.begins)


def possible(scan: Scan) -> list[Order]:
    """List the orders in which the beams of a scan may have been taken."""
    is_round = abs(scan.angle_increment) * len(scan.ranges) > ROUND
    return [*(ALL_ROUND if is_round else (RISING, FALLING)), AT_ONCE]
