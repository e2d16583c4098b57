# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was wrong with the data of a replay: counted by kind, and said once per kind."""

from collections import Counter

USUAL = ('match_rejected', 'odometry_jumps')   # faults of a drive, not of its data
MANY = 0.2   # share of the scans from which those are said all the same
AT_ENDS = ('scans_without_odometry', 'scans_before_odometry')   # faults at both ends of a log
FEW = 0.05   # share of the scans up to which those are not said


class FaultLog:
    """Counts faults by kind, and keeps the first reason of each."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter({'scans_without_odometry': 0})
        self._reasons: dict[str, str] = {}

    def __call__(self, kind: str, reason: str = '') -> None:
        """Count one fault."""
        self.counts[kind] += 1
        self._reasons.setdefault(kind, reason)

    def notes(self, scans: int) -> list[str]:
        """Return the sentences on what was odd in a log of so many scans."""
        return [f'{kind}: {reason} ({self.counts[kind]} times)'
                for kind, reason in self._reasons.items()
                if kind != 'lost' and self.counts[kind] > scans * (   # that is said where it ends
                    MANY if kind in USUAL else FEW if kind in AT_ENDS else 0.0)]

    def main_cause(self) -> str:
        """Return the reason of the most frequent fault; '' where there was none."""
        found = [kind for kind, _ in self.counts.most_common() if self._reasons.get(kind)]
        return self._reasons[found[0]] if found else ''
