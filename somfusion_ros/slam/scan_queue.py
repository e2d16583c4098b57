# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans wait here until odometry covers their stamp, and stamps are watched for jumps in time.

Nothing here knows a message or a clock: what waits is any item, and time is given in.
"""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from somfusion_ros.slam.motion import Odometry, OdometryBuffer

MAX_WAITING = 200       # scans
JUMP_CONFIRMED = 5      # strange stamps in a row, rising among themselves, that mean a new time
MAX_GAP = 3600.0        # [s] a stamp that is farther ahead than this is strange


class Waiting(NamedTuple):
    """A scan that waits: stamp and sweep [s], when it arrived [s, steady clock], and the scan."""

    stamp: float
    sweep: float
    arrived: float
    item: Any


class ScanQueue:
    """Pairs scans with the odometry of their sweep; drops and counts those it never covers."""

    def __init__(self, buffer: OdometryBuffer, timeout: float, count: Callable[..., None]) -> None:
        self._buffer, self._timeout, self._count = buffer, timeout, count
        self._waiting: deque[Waiting] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, stamp: float, item: Any, now: float, sweep: float = 0.0) -> None:
        """Let a scan wait."""
        self._waiting.append(Waiting(stamp, sweep, now, item))
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._count('scans_too_many', 'scans come faster than they can be processed')

    def ready(self, now: float) -> Iterator[tuple[Any, Odometry]]:
        """Yield the scans that odometry covers now, in order."""
        while self._waiting:
            first = self._waiting[0]
            late = now - first.arrived > self._timeout
            odometry = self._buffer.at(first.stamp, 0.0 if late else first.sweep)
            if odometry is not None:
                self._waiting.popleft()
                yield first.item, odometry
            elif self._buffer.passed(first.stamp):
                self._waiting.popleft()   # odometry only goes on, so it is never covered
                self._count('scans_before_odometry', 'a scan is older than the first odometry')
            elif late:
                self._waiting.popleft()
                self._count('scans_without_odometry',
                            f'no odometry covered a scan within {self._timeout} s')
            else:
                return

    def clear(self) -> None:
        """Let no scan wait any more, after a jump in time."""
        self._waiting.clear()


class StampGuard:
    """
    Tells a stray stamp from time that jumped.

    One strange stamp is a fault of that message. Several in a row that follow one another mean
    that time itself was set back or ahead, as when a simulation or a recording starts again.
    """

    def __init__(self) -> None:
        self._last: float | None = None
        self._strange: list[float] = []

    def check(self, stamp: float) -> str:
        """Tell whether a stamp [s] is `good`, `stray`, `jumped_back` or `jumped_ahead`."""
        if self._last is None or 0.0 <= stamp - self._last <= MAX_GAP:
            self._last, self._strange = stamp, []
            return 'good'
        if self._strange and not 0.0 < stamp - self._strange[-1] <= MAX_GAP:
            self._strange = []
        self._strange.append(stamp)
        if len(self._strange) < JUMP_CONFIRMED:
            return 'stray'
        word = 'jumped_back' if stamp < self._last else 'jumped_ahead'
        self._last, self._strange = stamp, []
        return word
