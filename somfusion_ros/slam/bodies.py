# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Other robots in a scan: they are no walls, and they are gone in a moment."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import apply, Array, compose
from somfusion_ros.slam.scan import Scan


def hide_bodies(scan: Scan, T_map_base: ArrayLike, bodies: Array, radius: float) -> Scan:
    """
    Leave out the returns of a scan that lie on a robot's body.

    Parameters
    ----------
    scan : the scan
    T_map_base : pose of the robot that took it
    bodies : places (N, 2) [m] of other robots in the map
    radius : returns within this distance [m] of one are left out, as if they had failed (NaN)
    """
    if scan.fault() or not len(bodies):
        return scan
    ranges = np.array(scan.ranges, dtype=float)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    returned = np.isfinite(ranges)
    beams = np.where(returned, ranges, 0.0)[:, None] * np.column_stack(
        [np.cos(angles), np.sin(angles)])
    ends = apply(compose(T_map_base, scan.T_base_laser), beams)
    away = np.hypot(*(ends[:, None] - np.asarray(bodies)).T).min(0)
    ranges[returned & (away < radius)] = np.nan
    return replace(scan, ranges=ranges)
