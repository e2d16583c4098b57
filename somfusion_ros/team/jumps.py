# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accepted transforms that gave way to one elsewhere, counted."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import between, Pose
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class JumpTuning:
    """What is counted as a jump."""

    distance: float = tuned(
        0.2, 'm', 'an accepted transform that moves by more is counted as a jump; more than a '
        'pose that holds moves at once', 'by design')
    heading: float = tuned(
        float(np.radians(2.0)), 'rad', 'the same for the heading', 'by design')


TUNING = JumpTuning()


class Jumps:
    """Counts the jumps of the accepted transforms to peers."""

    def __init__(self) -> None:
        self.count = 0
        self._accepted: dict[str, Pose] = {}

    def look(self, peer: str, accepted: Pose | None) -> None:
        """Count an accepted transform that gave way to one elsewhere, at once or after a while."""
        if accepted is not None:
            step = between(self._accepted.get(peer, accepted), accepted)
            self.count += bool(np.hypot(step[0], step[1]) > TUNING.distance
                               or abs(step[2]) > TUNING.heading)
            self._accepted[peer] = accepted

    def peers(self) -> list[str]:
        """Return the peers whose transform was accepted."""
        return list(self._accepted)

    def keep(self, robots: Collection[str]) -> None:
        """Forget where the maps of all others lay: nobody knows these robots any more."""
        self._accepted = {peer: pose for peer, pose in self._accepted.items() if peer in robots}

    def forget(self, peer: str) -> None:
        """Forget where a peer's map lay: it is another one."""
        self._accepted.pop(peer, None)
