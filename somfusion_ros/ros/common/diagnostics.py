# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node publishes on /diagnostics: statuses, and counts of faults by name."""

from collections import Counter
from collections.abc import Callable, Mapping
import math
import threading
import time
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

REPEAT = 60.0   # [s] between two lines in the log about the same kind of fault


class Faults:
    """
    Counts of what was wrong with incoming data, by kind; the log names each kind, at most rarely.

    now returns the time [s] of a steady clock.
    """

    def __init__(self, logger: Any, now: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._now = logger, now
        self._counts: Counter[str] = Counter()
        self._due: dict[str, float] = {}
        self._lock = threading.Lock()

    def __call__(self, kind: str, reason: str = '', patience: float = 0.0) -> None:
        """
        Count one fault, and log it with its reason unless its kind was logged lately.

        What is usual for a moment after the start is logged once it has lasted for patience [s].
        """
        with self._lock:
            self._counts[kind] += 1
            now, count = self._now(), self._counts[kind]
            if now < self._due.setdefault(kind, now + patience):
                return
            self._due[kind] = now + REPEAT
        self._logger.warning(f'{kind}: {reason} ({count} so far; all are counted in '
                             '/diagnostics)')

    def counts(self) -> dict[str, int]:
        """Return the counts so far."""
        with self._lock:
            return dict(self._counts)


def status(name: str, hardware_id: str, values: Mapping[str, Any], warning: str = '',
           error: str = '') -> DiagnosticStatus:
    """Make one status; a warning or an error sets its level and its message."""
    level = (DiagnosticStatus.ERROR if error else
             DiagnosticStatus.WARN if warning else DiagnosticStatus.OK)
    return DiagnosticStatus(
        level=level, name=name, hardware_id=hardware_id, message=error or warning or 'ok',
        values=[KeyValue(key=key, value=text(value)) for key, value in values.items()])


def diagnostic_array(stamp: Time, statuses: list[DiagnosticStatus]) -> DiagnosticArray:
    """Bundle statuses into the message of /diagnostics."""
    return DiagnosticArray(header=Header(stamp=stamp), status=statuses)


def text(value: Any) -> str:
    """Write a value with as many digits as a reader can use."""
    if isinstance(value, float):
        return f'{value:.4g}' if math.isfinite(value) else str(value)
    return str(value)
