# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A second look at views that little holds: whether they fit the map before them at another place.

Along a corridor all walls seen before are seen again, wherever in it a robot was put down. Where
what it saw since disagrees with the map, that is searched for in the whole map, as for a lost
robot. How much of it the map explains does not count: the robot may have left the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.relocation import KnownMap, Query
from somfusion_ros.slam.relocation_tuning import TUNING as RELOCATION
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class SecondLookTuning:
    """When another place is believed against the one where a robot seems to be."""

    disagrees: float = tuned(
        0.03, 'share', 'of what both saw, that disagrees here; below, no other place is sought',
        'benchmarks/slam/carried.py, shared logs')
    clearer: float = tuned(
        3.0, 'times', 'as much must disagree here as there', 'benchmarks/slam/carried.py')
    around: float = tuned(
        15.0, 'm', 'within which views are asked what they saw here', 'by design')
    away: tuple[float, float] = tuned(
        (1.0, 0.5), 'm, rad', 'beyond which it is another place', 'by design')


TUNING = SecondLookTuning()


@dataclass(frozen=True, eq=False)
class SecondLook:
    """Views at poses (n, 3), what they saw, and the scans kept for the map that hang on them."""

    poses: Array
    clouds: Sequence[Cloud]
    scans: Sequence[MapScan]
    resolution: float

    def elsewhere(self, first: int) -> bool:
        """Return whether the views from one on, up to the last, belong to another place."""
        n, here = len(self.poses), self.poses[-1]
        if n - first < RELOCATION.views_least:
            return False
        query = Query.of_views(self.poses[first:], self.clouds[first:],
                               self._drawn(range(first, n)))
        if len(query.cloud) < RELOCATION.views_least:
            return False
        around = np.hypot(*(self.poses[:first, :2] - here[:2]).T) < TUNING.around
        against = 1.0 - self._known(np.flatnonzero(around)).place(query, here).agreement
        if against <= TUNING.disagrees:
            return False
        there = self._known(np.arange(first)).find(query)
        return (there is not None and not there.refusal()
                and against > TUNING.clearer * (1.0 - there.agreement)
                and _apart(between(here, there.match.T_map_scan)))

    def _known(self, views: Array) -> KnownMap:
        """Return what some of the views saw, to be searched."""
        return KnownMap(self.poses[views], [self.clouds[k] for k in views],
                        self._drawn(views.tolist()))

    def _drawn(self, views: Sequence[int]) -> Grid:
        """Draw the scans that hang on some of the views."""
        chosen = set(views)
        return Mapper(self.resolution).render(
            [scan for scan in self.scans if scan.view in chosen], self.poses)


def _apart(d: Array) -> bool:
    """Return whether poses are at two places that differ by (3,)."""
    return bool(np.hypot(d[0], d[1]) > TUNING.away[0] or abs(d[2]) > TUNING.away[1])
