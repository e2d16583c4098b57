# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scans kept for the map: of every place the newest few, however long the robot drives."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline

Place = tuple[int, int, int]   # column and row of a square, and sector of the heading


@dataclass(frozen=True)
class MapScanTuning:
    """How many scans draw one place."""

    square: float = tuned(
        0.5, 'm', 'edge of the square within which scans are taken from one place',
        'benchmarks/life.py')
    sectors: int = tuned(
        6, 'sectors', 'of the heading, within which scans look the same way', 'by design')
    kept: int = tuned(
        4, 'scans', 'kept of one place, the newest; with 8 the share of right walls is the same, '
        'and a map takes longer to fill up', 'benchmarks/life.py, benchmarks/week.py, CSAIL')
    often: int = tuned(
        8, 'scans', 'taken at one place make it one where the robot has been often', 'shared logs')


TUNING = MapScanTuning()


@dataclass(frozen=True, eq=False, slots=True)
class MapScan:
    """A scan kept for the map: the view it hangs on, T_view_base (3,), and what it saw."""

    view: int
    T_view_base: Array
    outline: Outline


class MapScans:
    """
    Scans by age; when a place has enough of them its oldest is dropped.

    Thereby memory is bounded by the area, and what was removed or is new replaces what was seen
    there before.
    """

    def __init__(self) -> None:
        self._scans: dict[MapScan, None] = {}
        self._places: defaultdict[Place, list[MapScan]] = defaultdict(list)
        self._taken: Counter[Place] = Counter()
        self.newest_at = np.zeros(3)     # pose in the map

    def __len__(self) -> int:
        return len(self._scans)

    def __iter__(self) -> Iterator[MapScan]:
        return iter(self._scans)

    def add(self, scan: MapScan, pose: Array) -> None:
        """Keep a scan taken at a pose (3,) in the map."""
        self._scans[scan] = None
        self.newest_at = pose
        self._taken[place_of(pose)] += 1
        here = self._places[place_of(pose)]
        here.append(scan)
        if len(here) > TUNING.kept:
            del self._scans[here.pop(0)]

    def often(self, pose: Array) -> bool:
        """Return whether many scans were taken where a pose (3,) is."""
        return self._taken[place_of(pose)] >= TUNING.often

    def extend(self, scans: Iterable[MapScan], poses: Array) -> None:
        """Keep scans by age, taken at poses (n, 3)."""
        for scan, pose in zip(scans, poses, strict=True):
            self.add(scan, pose)

    def resume(self) -> None:
        """Take it that the robot has been often where all scans are kept that may be."""
        for there, scans in self._places.items():
            self._taken[there] = TUNING.often * (len(scans) >= TUNING.kept)

    def drop(self, view: int) -> None:
        """Drop the scans that hang on a view, or on a later one."""
        for scan in [scan for scan in self._scans if scan.view >= view]:
            del self._scans[scan]
        for here in self._places.values():
            here[:] = [scan for scan in here if scan in self._scans]

    def copy(self) -> list[MapScan]:
        """Return the scans by age."""
        return list(self._scans)


def place_of(pose: Array) -> Place:
    """Return the square and the sector of the heading of a pose (3,)."""
    x, y, theta = pose.tolist()
    sector = int(np.floor(theta * TUNING.sectors / (2.0 * np.pi))) % TUNING.sectors
    return (int(np.floor(x / TUNING.square)), int(np.floor(y / TUNING.square)), sector)
