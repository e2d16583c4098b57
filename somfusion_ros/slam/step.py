# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one scan did to the estimate."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class Step:
    """
    What one scan did.

    stamp [s], pose T_map_base and its covariance (3, 3), T_map_odom, whether the scan could be
    used, whether it was matched and how much of it, whether it became a view, what was wrong
    with it ('' if nothing), the view that the pose hangs on, and the motion (3,) since the scan
    before: as the scans show it, also of a lost robot, and whatever else moved the pose; None
    where they do not.
    """

    stamp: float
    pose: Pose
    covariance: Array
    T_map_odom: Pose
    accepted: bool
    matched: bool
    inlier_ratio: float
    is_view: bool
    reason: str
    view: int = 0
    moved: Array | None = None
