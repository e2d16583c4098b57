# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One laser scan, and the points that it saw."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import Pose


@dataclass(frozen=True, eq=False)
class Scan:
    """
    A planar laser scan (sensor_msgs/LaserScan, REP-117).

    stamp [s] of the first beam, ranges (B,) [m], angles [rad] in the laser frame, range limits
    [m], time_increment [s] between beams, and the laser's mount on the robot.
    """

    stamp: float
    ranges: NDArray[np.float64]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float = 0.0
    T_base_laser: Pose = field(default_factory=Pose)
