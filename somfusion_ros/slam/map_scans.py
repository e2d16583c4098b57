# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scans kept for the map: of every place the newest few, however long the robot drives."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from somfusion_ros.geometry import Array, difference
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
    standing: int = tuned(
        5, 'scans', 'kept where a robot stands: as many make free what they look through',
        'by design')
    pause: float = tuned(
        0.5, 's', 'between two scans of a robot that stands', 'by design')
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
        self._newest_at, self._newest = np.zeros(3), -np.inf     # pose in the map, stamp

    def __len__(self) -> int:
        return len(self._scans)

    def __iter__(self) -> Iterator[MapScan]:
        return iter(self._scans)

    def add(self, scan: MapScan, pose: Array, stamp: float = -np.inf,
            most: int = TUNING.kept) -> None:
        """Keep a scan taken at a pose (3,) in the map and a stamp [s], of its place the newest."""
        self._scans[scan] = None
        self._newest_at, self._newest = pose, stamp
        self._taken[place_of(pose)] += 1
        here = self._places[place_of(pose)]
        here.append(scan)
        while len(here) > most:
            del self._scans[here.pop(0)]

    def offer(self, scan: MapScan, pose: Array, stamp: float, spacing: float) -> None:
        """Keep a scan where the robot moved on by a spacing [m, rad], or stands and has few."""
        if not _within(spacing, pose, self._newest_at):
            self.add(scan, pose, stamp)
        elif stamp - self._newest >= TUNING.pause and max(
                len(self._places.get(place_of(pose), ())),
                self._alike(scan, spacing)) < TUNING.standing:    # it may stand between places
            self.add(scan, pose, stamp, TUNING.standing)

    def _alike(self, scan: MapScan, spacing: float) -> int:
        """Count those of the newest scans that were taken where a scan was."""
        return sum(last.view == scan.view and _within(spacing, last.T_view_base, scan.T_view_base)
                   for last in islice(reversed(self._scans), TUNING.standing))

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


def _within(spacing: float, pose: Array, other: Array) -> bool:
    """Return whether poses (3,) differ by less than a spacing [m, rad]."""
    d = difference(pose, other)
    return bool(np.hypot(d[0], d[1]) < spacing and abs(d[2]) < spacing)


def place_of(pose: Array) -> Place:
    """Return the square and the sector of the heading of a pose (3,)."""
    x, y, theta = pose.tolist()
    sector = int(np.floor(theta * TUNING.sectors / (2.0 * np.pi))) % TUNING.sectors
    return (int(np.floor(x / TUNING.square)), int(np.floor(y / TUNING.square)), sector)
