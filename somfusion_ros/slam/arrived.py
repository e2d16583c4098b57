# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan as it arrived beside the odometry."""

from typing import Any, NamedTuple


class Arrived(NamedTuple):
    """
    A scan as it arrived: its own stamp [s], that of the newest odometry then, and the scan.

    By arrived [s, steady clock], so many messages of odometry had come. laser: which took it.
    """

    stamp: float
    newest_odometry: float
    item: Any
    arrived: float
    messages: int
    laser: str

    @property
    def offset(self) -> float:
        """Stamp against that of the newest odometry [s]."""
        return self.stamp - self.newest_odometry

    def same_time(self, other: 'Arrived') -> bool:
        """Return whether its clock stands still, as another one of its laser has its stamp."""
        return self.stamp == other.stamp and self.laser == other.laser
