# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How long a robot that begins maps anew is left alone before it is matched."""

from dataclasses import dataclass

from somfusion_ros.settings import tuned

MOST_DOUBLINGS = 16   # of the pause after a new map; by then it is as long as it gets


@dataclass(frozen=True)
class PauseTuning:
    """How long a peer that begins maps anew is left alone."""

    first_pause: float = tuned(
        5.0, 's', 'a peer that begins a new map for the second time is not matched for twice '
        'this time, and twice as long again every time after', 'by design')
    longest_pause: float = tuned(
        600.0, 's', 'a peer is never left alone for longer', 'by design')
    longest_return: float = tuned(
        30.0, 's', 'nor for longer than this where its map went back', 'by design')


TUNING = PauseTuning()


def pause_after(begun: int, back: bool) -> float:
    """
    Return how long [s] a robot is not matched that has begun so many maps before its newest.

    back: it only went back to an earlier state of its map.
    """
    if not begun:
        return 0.0
    longest = TUNING.longest_return if back else TUNING.longest_pause
    return min(TUNING.first_pause * 2.0 ** min(begun, MOST_DOUBLINGS), longest)
