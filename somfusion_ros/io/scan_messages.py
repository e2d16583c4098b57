# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fields of sensor_msgs/LaserScan, MultiEchoLaserScan and PointCloud2 to the core's scan.

No ROS is needed.

The ranges are handed on as they are: what 0, `inf` or a value above `range_max` means is decided
in one place for logs and live scans alike, `somfusion_ros.slam.laser`.
"""

from typing import Any

import numpy as np
from somfusion_ros.io.cloud_messages import scan_from_cloud
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.slam.scan import Scan

FULL_CIRCLE = 2.0 * np.pi
LASERS_APART = 1e-6   # [s] between the scans of two lasers of a robot that share one stamp
ROUNDED = 1.5   # beams by which angle_max may miss the last beam: drivers differ by one
LEAST_SHARE = 0.05   # of the step by angle_max, below which an increment is none
COUNTED = 0.15  # share by which beams may be fewer or more than the increment was made for


def scan_from(message: Any, mount: Mount, stamp: float, laser: str = '') -> Scan:
    """
    Convert a scan; a laser that hangs upside down turns the other way round.

    ValueError where a cloud has no points that can be read.
    """
    if hasattr(message, 'point_step'):
        return scan_from_cloud(message, mount, stamp, laser)
    with np.errstate(invalid='ignore'):   # a damaged file may hold signalling NaN
        ranges = np.array([one_range(told) for told in message.ranges] if hasattr(
            next(iter(message.ranges), 0.0), 'echoes') else message.ranges, dtype=float)
    start, increment, odd = angles(float(message.angle_min), float(message.angle_max),
                                   float(message.angle_increment), len(ranges))
    turn = -1.0 if mount.upside_down else 1.0
    return Scan(stamp, ranges, turn * start, turn * increment, float(message.range_min),
                float(message.range_max), float(message.time_increment), mount.T_base_laser,
                laser=laser or message.header.frame_id, odd=odd)


def one_range(told: Any) -> float:
    """Range [m] of a beam of sensor_msgs/MultiEchoLaserScan: its first echo; NaN without one."""
    return float(told.echoes[0]) if len(told.echoes) else float('nan')


def angles(start: float, end: float, increment: float, beams: int) -> tuple[float, float, str]:
    """
    Check the three angles of a scan by one another.

    Returns angle_min and angle_increment [rad] as they must have been meant, and what was mended,
    '' if nothing. An angle_max that says nothing, or no more than the increment, is not used.
    """
    span = end - start
    if beams < 2 or not np.isfinite((start, span)).all() or span == 0.0:
        return start, increment, ''
    if abs(span) > 1.05 * FULL_CIRCLE and abs(span) < 1.05 * 360.0 and abs(start) <= 360.0:
        start, increment, span = (float(np.radians(angle)) for angle in (start, increment, span))
        found = angles(start, start + span, increment, beams)
        return *found[:2], 'the angles are taken to be in degrees'
    by_end = span / (beams - 1)
    if abs(span) > 1.05 * FULL_CIRCLE or abs(increment - by_end) <= ROUNDED * abs(by_end) / (
            beams - 1):
        return start, increment, ''
    possible = 0.0 < abs(increment) * (beams - 1) <= 1.05 * FULL_CIRCLE
    if end == 0.0 and possible:
        return start, increment, ''   # nobody set angle_max
    told = (f'angle_min {start:g}, angle_max {end:g} and {beams} ranges are {by_end:g} rad apart, '
            f'not angle_increment = {increment:g}')
    alike = possible and increment * by_end > 0.0 and abs(increment) > LEAST_SHARE * abs(by_end)
    if alike and abs(increment - by_end) > COUNTED * abs(by_end):
        return start, increment, f'{told}: the increment is used'
    return start, by_end, f'{told}: the angles are used'
