# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""New views of what changed, and the old ones whose place they take once they are confirmed."""

from collections.abc import Sequence
from dataclasses import dataclass

from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class SuccessorTuning:
    """When a new view takes the place of old ones."""

    later: float = tuned(
        30.0, 's', 'after a view came, another pass that it explains confirms it: what only '
        'stood there for a moment does not take the place of what was there', 'benchmarks/week.py')


TUNING = SuccessorTuning()


class Successors:
    """
    Old views that did not explain what a new one, added at their place, saw.

    Both are kept until the robot comes back: if the new one explains what it sees then, the old
    ones show what is gone.
    """

    def __init__(self) -> None:
        self._old: dict[int, tuple[tuple[int, ...], float]] = {}

    def add(self, new: int, old: Sequence[int], stamp: float) -> None:
        """Note the old views that did not explain a new one, which came at a stamp [s]."""
        if old:
            self._old[new] = tuple(old), stamp

    def confirm(self, view: int, stamp: float) -> tuple[int, ...]:
        """Return the views whose place one takes that explains a scan of a stamp [s]."""
        old, came = self._old.get(view, ((), stamp))
        if stamp - came < TUNING.later:
            return ()
        del self._old[view]
        return old
