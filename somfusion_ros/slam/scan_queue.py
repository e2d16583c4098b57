# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans wait here until the odometry covers their sweep.

Nothing here knows a message or a clock: what waits is any item, and time is given in.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

from somfusion_ros.slam.lateness import TUNING as LATENESS
from somfusion_ros.slam.motion import Odometry, OdometryBuffer

MAX_WAITING = 200       # scans, of a live stream
OTHER_LASER = 0.3       # [s] for which a scan waits for an older one of another laser
SILENT = 5.0            # [s] after which no scan of a laser is waited for


class Waiting(NamedTuple):
    """A scan that waits: stamp and sweep [s], arrival [s, steady clock], the scan, its laser."""

    stamp: float
    sweep: float
    arrived: float
    item: Any
    laser: str


class ScanQueue:
    """Pairs scans with the odometry of their sweep; drops and counts those it never covers."""

    def __init__(self, buffer: OdometryBuffer, timeout: float, count: Callable[..., None],
                 capacity: int = MAX_WAITING) -> None:
        self._buffer, self._timeout, self._count = buffer, timeout, count
        self._capacity, self._longest = capacity, max(timeout, LATENESS.longest)
        self._waiting: deque[Waiting] = deque()
        self._newest: dict[str, float] = {}   # stamp [s] by laser
        self._guessed: float | None = None    # stamp [s] of a scan with odometry extrapolated
        self._latest: float | None = None     # stamp [s] of the newest odometry
        self._came = -inf                     # when it came [s, steady clock]
        self.late = False                     # whether odometry is on its way

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, stamp: float, item: Any, now: float, sweep: float = 0.0, laser: str = ''
            ) -> None:
        """
        Let a scan wait, in the order of the stamps of all lasers.

        Scans of the same laser that wait with a later stamp were not of this time, and of those
        with one stamp, as they were held on their way and stamped on arrival, the last is.
        """
        strays = [i for i, other in enumerate(self._waiting)
                  if other.laser == laser and other.stamp >= stamp]
        for i in reversed(strays):
            if self._waiting[i].stamp == stamp:
                self._count('scan_stamps_repeated', 'a scan has the stamp of the one before it')
            else:
                self._count('scan_stamps_stray', f'one is stamped {self._waiting[i].stamp:.3f} '
                            f's, those after it {stamp:.3f} s')
            del self._waiting[i]
        place = len(self._waiting)
        while place and self._waiting[place - 1].stamp > stamp:
            place -= 1
        self._waiting.insert(place, Waiting(stamp, sweep, now, item, laser))
        self._newest = {other: newest for other, newest in self._newest.items()
                        if abs(newest - stamp) < SILENT}
        self._newest[laser] = stamp
        if len(self._waiting) > self._capacity:
            first = self._waiting.popleft()
            if self._buffer.covers(first.stamp, first.sweep):
                self._count('scans_too_many', 'scans come faster than they can be processed')
            else:
                self._drop(first)

    def ready(self, now: float) -> Iterator[tuple[Any, Odometry]]:
        """
        Yield the scans that odometry covers now, in order.

        Where odometry stalls, a scan is paired with that which there is: that of its first beam,
        or the last one and its twist, if that is not long ago. Else it waits for what may be on
        its way.
        """
        self._look(now)
        while self._waiting:
            first = self._waiting[0]
            waited = now - first.arrived
            if not waited > self._timeout and self._is_early(first.stamp):
                return
            stalls = now - max(first.arrived, self._came if self.late else -inf) > self._timeout
            odometry = self._buffer.at(first.stamp, 0.0 if stalls else first.sweep)
            if odometry is not None:
                odometry = self._mended(odometry)
            elif stalls:
                odometry = self._buffer.extrapolated(first.stamp)
                self._guessed = self._guessed if odometry is None else first.stamp
            if odometry is not None:
                self._waiting.popleft()
                yield first.item, odometry
            elif waited > self._patience or self._buffer.passed(first.stamp):
                self._drop(self._waiting.popleft())
            else:
                return

    def first(self) -> Any:
        """Return the first scan that waits, whatever the odometry; None where none may go."""
        if not self._waiting or self._is_early(self._waiting[0].stamp):
            return None
        return self._waiting.popleft().item

    def clear(self) -> None:
        """Drop all waiting scans, after a jump in time."""
        self._waiting.clear()
        self._newest.clear()

    @property
    def _patience(self) -> float:
        """Time [s] for which a scan waits for odometry: longer where it may be late."""
        return self._timeout if self._latest is None else self._longest

    def _look(self, now: float) -> None:
        """Note when [s] the newest odometry came; at the end of a log none comes any more."""
        if self._buffer.latest != self._latest and now < inf:
            self._came = self._came if self._latest is None else now
            self._latest = self._buffer.latest

    def _mended(self, odometry: Odometry) -> Odometry:
        """Return odometry with that of the scan before, where that had been extrapolated."""
        guessed, self._guessed = self._guessed, None
        return odometry if guessed is None else replace(odometry, before=self._buffer.at(guessed))

    def _is_early(self, stamp: float) -> bool:
        """Tell whether an older scan of another laser may still come."""
        newest = self._newest.values()
        return (any(stamp - SILENT < other < stamp for other in newest)
                and max(newest) - stamp < OTHER_LASER)

    def _drop(self, scan: Waiting) -> None:
        """Count a scan that no odometry covers, with what is true of it."""
        latest = self._buffer.latest
        if latest is None:
            self._count('scans_without_odometry', 'no odometry has come')
        elif self._buffer.passed(scan.stamp):   # odometry only goes on, so it is never covered
            self._count('scans_before_odometry', 'a scan is older than the first odometry')
        else:
            self._count('scans_without_odometry',
                        f'a scan is stamped {scan.stamp - latest:.3f} s after the newest odometry '
                        'that came in time')
