# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How long the stages of a merge take."""

from time import perf_counter


class Stopwatch:
    """Seconds per stage."""

    def __init__(self) -> None:
        """Start."""
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        """Note what passed since the last call under the name of a stage."""
        now = perf_counter()
        self.seconds[stage], self._last = now - self._last, now
