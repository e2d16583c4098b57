# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A clock that stands still while its messages go on."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class StandingTuning:
    """When a clock is taken to stand still."""

    messages: int = tuned(
        3, 'messages', 'of one stamp, none like the one before it; logs have two', 'by design')
    moment: float = tuned(
        0.25, 's', 'in which these come at least; what was held on its way and stamped when it '
        'came comes at once', 'benchmarks/slam/clocks.py')


TUNING = StandingTuning()


class StandingClock:
    """
    Mends the stamps of one stream of messages while its clock stands still.

    They go on as the messages come, until the clock is right again, or for good where it goes on
    from where it stood; shift [s] is what is added then.
    """

    def __init__(self, stream: str, count: Callable[..., None]) -> None:
        self._stream, self._count = stream, count
        self.shift = 0.0
        self._stamp, self._since = -np.inf, 0.0    # [s] of the clock, and when it came to it
        self._content = np.empty(0)
        self._messages, self._stands = 0, False

    def mend(self, stamp: float, content: Array, now: float) -> float:
        """
        Return when a message was made, by a clock that does not stand still.

        Parameters
        ----------
        stamp : by the clock [s]
        content : (N,), what tells a new message from one that is told again
        now : when it came [s, steady clock]

        """
        passed = now - self._since
        if stamp != self._stamp:
            self._go_on(stamp - self._stamp, passed)
            self._stamp, self._since, self._content = stamp, now, content
            self._messages, self._stands = 1, False
            return stamp + self.shift
        if not np.array_equal(content, self._content, equal_nan=True):
            self._messages += 1
            self._content = content
        if self._messages < TUNING.messages or passed < TUNING.moment:
            return stamp + self.shift
        if not self._stands:
            self._count(f'{self._stream}_clock_stood', f'at {stamp:.3f} s, while messages went '
                        'on: they are stamped by when they come')
        self._stands = True
        return stamp + self.shift + passed

    def _go_on(self, ahead: float, passed: float) -> None:
        """Shift a clock that goes on [s] where it stood for a time [s]; else it is right again."""
        if self._stands and abs(ahead) < abs(ahead - passed):
            self.shift += passed - max(ahead, 0.0)
