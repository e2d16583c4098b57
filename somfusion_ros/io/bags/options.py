# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be used of a bag, where it is not left to be found."""

from dataclasses import dataclass

from somfusion_ros.geometry import Pose


@dataclass(frozen=True)
class BagOptions:
    """
    What is to be used of a bag; None and 'auto' mean: found in the bag.

    odometry_source as in SlamNodeConfig. Encoders need wheel_radius and wheel_separation [m].
    laser_pose is T_base_laser; scans of a laser mounted upside down are turned over only when the
    mount comes from the bag. namespace is that of one robot of several; '' the only one.
    """

    scan_topic: str | None = None
    odom_topic: str | None = None
    odometry_source: str = 'auto'
    laser_pose: Pose | None = None
    wheel_radius: float | None = None
    wheel_separation: float | None = None
    namespace: str = ''
