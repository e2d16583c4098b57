# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tracker made of one scan."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array


@dataclass(frozen=True, eq=False)
class Track:
    """
    The state after one scan.

    T_view_base (3,) from the last view, the covariance R (3, 3) with which the views after this
    one inherit its error, whether a match corrected it, the share of the scan that the match
    explained, whether it lies near where the odometry expected it, what was wrong, '' if
    nothing, and the motion (3,) since the scan before, None unless both were matched.
    """

    T_view_base: Array
    R: Array
    matched: bool
    inlier_ratio: float
    expected: bool
    reason: str
    moved: Array | None = None

    def fits(self, least: float) -> bool:
        """Return whether a match near the prediction explains at least a share of the scan."""
        return self.matched and self.expected and self.inlier_ratio >= least
