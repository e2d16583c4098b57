# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How slow the machine is now, for waits that must not depend on what else it does."""

import time

SAMPLE = 0.1      # [s] of computing that is timed
SLOWEST = 6.0     # a machine that is slower than this fails its tests


def pace() -> float:
    """
    Return by how much longer computing takes now than on cores of its own, 1 to SLOWEST.

    The time that a short piece of work takes by the clock, over the time that it has a core.
    """
    wall, cpu = time.monotonic(), time.process_time()
    while time.process_time() - cpu < SAMPLE:
        pass
    return min(max((time.monotonic() - wall) / SAMPLE, 1.0), SLOWEST)


def patient(seconds: float, since: float) -> bool:
    """Return whether a wait of some seconds, begun at a time of the steady clock, goes on."""
    passed = time.monotonic() - since
    return passed < seconds or passed < SLOWEST * seconds and passed < pace() * seconds
