# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Odometry that comes late, told from odometry of a clock that is wrong.

Both fall behind the scans. A slow network, or a busy computer, holds messages back: by just as
much time as the odometry is behind, fewer have come than usual. Of a clock that is slow or was
set back, all messages come.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp

from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class LatenessTuning:
    """Tuned numbers of late odometry."""

    on_time: float = tuned(
        0.3, 's', 'by which odometry may be behind what is usual, and still be on time',
        'by design')
    longest: float = tuned(
        6.0, 's', 'for which scans wait for odometry that is late; the pose is as old then',
        'benchmarks/slam/clocks.py')
    settling: float = tuned(
        10.0, 's', 'in which what is believed to be on its way follows what the stamps say, as '
        'messages are lost, too', 'by design')
    memory: float = tuned(
        100.0, 's', 'of odometry that came on time, of which it is known how often it comes',
        'by design')


TUNING = LatenessTuning()


class Lateness:
    """Keeps an account of the messages of odometry, and of how late [s] they come."""

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self.seconds = 0.0            # by which it is late now, where that is worth a word
        self._last: tuple[float, int] | None = None      # account, and the one on time
        self._on_time = (0.0, 0)
        self._time = self._messages = 0.0     # [s] on time, of late, and messages in it
        self._passed = 0.0                    # [s] since the last account
        self._due = 0.0               # [s] of odometry whose messages have not come yet

    @property
    def is_due(self) -> bool:
        """Whether odometry is on its way, by the messages that have not come yet."""
        return self._due > TUNING.on_time

    def hear(self, now: float, messages: int) -> None:
        """Take the number of messages that have come by a time [s, steady clock]."""
        if self._last is None:
            self._last = self._on_time = now, messages
        self._passed = now - self._last[0]
        interval = self._time / self._messages if self._messages else 0.0
        self._due += self._passed - interval * (messages - self._last[1])
        self._last = now, messages

    def is_behind(self, behind: float) -> None:
        """Take by how much [s] odometry is behind what is usual, where no clock is in doubt."""
        self.seconds = behind if self.seconds else 0.0
        if behind > TUNING.on_time or self._last is None:
            return
        self.seconds = self._due = 0.0
        passed, came = self._last[0] - self._on_time[0], self._last[1] - self._on_time[1]
        fading = exp(-passed / TUNING.memory)
        self._time = fading * (self._time + passed)
        self._messages = fading * (self._messages + came)
        self._on_time = self._last

    def explains(self, behind: float, tolerance: float) -> bool:
        """Return whether odometry is late where it is so far behind [s], up to a tolerance."""
        missed = behind - self._due
        if behind < 0.0 or behind > TUNING.longest or missed > tolerance:
            return False
        if not self.seconds:
            self._count('odometry_late', f'it comes {behind:.1f} s late, by a slow network or a '
                        'busy computer; scans wait for it, and the pose is as old')
        self.seconds = behind
        self._due += missed * min(1.0, self._passed / TUNING.settling)
        return True
