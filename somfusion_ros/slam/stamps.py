# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The stamps of one stream of messages: which of them are stray, and where its clock leaps.

A stamp is judged by the stamps around it, not alone: one that is far from both its neighbours is
the fault of one message, and one that the next stamps go on from means that time itself leapt, by
a pause of the sensor or by a step of its clock. Nothing here knows a clock: stamps are given in.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class StampTuning:
    """Tuned numbers of the judgement of stamps."""

    leap: float = tuned(
        1.0, 's', 'a step ahead that is longer, and longer than `periods`, waits for the next '
        'stamp to confirm it; shorter makes ordinary hiccups wait', 'by design')
    periods: float = tuned(
        5.0, 'periods', 'of the stream that a step may last without a second look; logs with a '
        'scan per metre pause this long all the time', 'by design')
    backward: int = tuned(
        3, 'stamps', 'in a row, rising among themselves, that make a step back a step of the '
        'clock; two messages may be late together', 'by design')
    longest: float = tuned(
        3600.0, 's', 'of a step ahead while the period is not known yet', 'by design')


TUNING = StampTuning()
MOST_DOUBTFUL = 100   # messages that wait


class Stamped(NamedTuple):
    """A message that waits to be judged: its stamp [s], and the message."""

    stamp: float
    item: Any


@dataclass
class Judgement:
    """
    What one more stamp made clear.

    good: messages that may go on, in order; stray: stamps [s] of those that are left out; leap:
    the step [s] from the last good stamp to the first of `good` where that was doubtful, else 0.
    """

    good: list[Stamped] = field(default_factory=list)
    stray: list[float] = field(default_factory=list)
    leap: float = 0.0


class StampStream:
    """Judges the stamps of one stream."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._steps: deque[float] = deque(maxlen=15)
        self._doubtful: list[Stamped] = []

    @property
    def period(self) -> float:
        """Median time [s] between two messages of late; 0 before it is known."""
        return float(np.median(self._steps)) if len(self._steps) >= 5 else 0.0

    @property
    def last(self) -> float:
        """Newest good stamp [s]; -inf before the first."""
        return -np.inf if self._last is None else self._last

    def add(self, stamp: float, item: Any) -> Judgement:
        """Judge a stamp [s], and those that waited for it."""
        if not np.isfinite(stamp):
            return Judgement(stray=[stamp])
        if self._last is None or 0.0 <= stamp - self._last <= self._longest_step():
            stray = [doubtful.stamp for doubtful in self._doubtful]
            self._doubtful = []
            self._go_on(stamp)
            return Judgement([Stamped(stamp, item)], stray)
        stray = []
        if self._doubtful and (stamp < self._doubtful[-1].stamp
                               or len(self._doubtful) == MOST_DOUBTFUL):
            stray = [doubtful.stamp for doubtful in self._doubtful]
            self._doubtful = []
        self._doubtful.append(Stamped(stamp, item))
        ahead = self._doubtful[0].stamp > self._last
        distinct = len({doubtful.stamp for doubtful in self._doubtful})   # some logs repeat stamps
        if distinct < (2 if ahead else TUNING.backward):
            return Judgement(stray=stray)
        return self._leap(stray)

    def flush(self) -> Judgement:
        """Return what waits at the end of a log: a last message after a pause is no fault."""
        if self._doubtful and self._last is not None and self._doubtful[0].stamp > self._last:
            return self._leap([])
        stray = [doubtful.stamp for doubtful in self._doubtful]
        self._doubtful = []
        return Judgement(stray=stray)

    def _leap(self, stray: list[float]) -> Judgement:
        """Believe the doubtful stamps: time leapt."""
        good, self._doubtful = self._doubtful, []
        leap = good[0].stamp - self.last
        self._last = good[0].stamp
        for stamped in good[1:]:
            self._go_on(stamped.stamp)
        return Judgement(good, stray, leap)

    def _go_on(self, stamp: float) -> None:
        """Record a good stamp as the newest."""
        if self._last is not None and stamp > self._last:
            self._steps.append(stamp - self._last)
        self._last = stamp

    def _longest_step(self) -> float:
        """Return the longest step [s] ahead that is nothing special."""
        return max(TUNING.leap, TUNING.periods * self.period) if self.period else TUNING.longest
