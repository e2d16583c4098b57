# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fields of sensor_msgs/PointCloud2 to the core's scan: a level slice of the cloud; no ROS is needed.

In every direction the nearest point counts that lies about as high as the laser. Where none does,
nothing is known: a cloud does not tell which of its beams passed.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.slam.scan import Scan

BAND = (-0.25, 0.25)      # [m] of height about the laser in which points are walls
ABOVE_GROUND = 0.1        # [m] from which points are walls, where the laser's height is known
BEAMS = (1440, 720, 360, 180)   # directions of a scan; the finest that the points fill
RANGE_MIN, RANGE_MAX = 0.1, 100.0   # [m]
ON_DIRECTIONS = 0.5       # share of the points that lie on equal steps of angle
KINDS = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}   # PointField


def scan_from_cloud(message: Any, mount: Mount, stamp: float, laser: str = '') -> Scan:
    """
    Cut a level slice out of a cloud, as a scan whose beams were taken at once.

    ValueError where the cloud has no usable x, y and z.
    """
    x, y, z = _coordinates(message).astype(float)
    low, high = BAND
    if mount.height > ABOVE_GROUND - low - 0.1:
        low = max(low, ABOVE_GROUND - mount.height)
    with np.errstate(invalid='ignore', over='ignore'):
        ranges = np.hypot(x, y)
        used = ((low <= z) & (z <= high) if not mount.upside_down else (-high <= z) & (z <= -low))
        used &= (ranges >= RANGE_MIN) & (ranges < RANGE_MAX)   # NaN is neither
    ranges, angles = ranges[used], np.arctan2(y[used], x[used])
    beams = _beams(angles)
    increment = 2.0 * np.pi / beams
    start = _phase(angles, beams)
    direction = np.rint((angles - start) / increment).astype(np.intp) % beams
    nearest = np.full(beams, np.inf)
    np.minimum.at(nearest, direction, ranges)
    turn = -1.0 if mount.upside_down else 1.0
    return Scan(stamp, np.where(np.isfinite(nearest), nearest, np.nan),
                turn * start, turn * increment, RANGE_MIN, RANGE_MAX, 0.0,
                mount.T_base_laser, laser=laser or message.header.frame_id)


def _coordinates(message: Any) -> NDArray[Any]:
    """Return x, y, z (3, N) [m] of a cloud's points; ValueError where it has none."""
    kinds = {field.name: (int(field.offset), KINDS.get(int(field.datatype), ''))
             for field in message.fields}
    width, height = int(message.width), int(message.height)
    step, row = int(message.point_step), int(message.row_step)
    order = '>' if message.is_bigendian else '<'
    if not all(kinds.get(name, (0, ''))[1] for name in 'xyz'):
        raise ValueError(f'a cloud without x, y and z, only {", ".join(kinds) or "nothing"}')
    data = np.frombuffer(message.data, np.uint8)
    row = row if row >= width * step else width * step
    ends = [offset + np.dtype(kind).itemsize for offset, kind in (kinds[n] for n in 'xyz')]
    if step < max(ends) or len(data) < max(height - 1, 0) * row + width * step:
        raise ValueError(f'a cloud of {width} x {height} points of {step} bytes has '
                         f'{len(data)} bytes')
    if not width * height:
        return np.zeros((3, 0))
    return np.array([np.ndarray((height, width), order + kind, data, offset, (row, step)).ravel()
                     for offset, kind in (kinds[name] for name in 'xyz')], dtype=float)


def _beams(angles: Array) -> int:
    """Return how many directions points at angles (N,) [rad] fill, more or less."""
    if len(angles) < 3:
        return BEAMS[-1]
    gaps = np.diff(np.sort(angles))
    gaps = gaps[gaps > 1e-4]   # the rings of a cloud lie above one another
    usual = float(np.median(gaps)) if len(gaps) else 1.0
    return next((beams for beams in BEAMS if 1.05 * 2.0 * np.pi / beams >= usual), BEAMS[-1])


def _phase(angles: Array, beams: int) -> float:
    """Return the angle [rad] of the first of the directions on which the points lie best."""
    mean = np.exp(1j * beams * angles).mean() if len(angles) else 0.0
    return float(np.angle(mean)) / beams if abs(mean) > ON_DIRECTIONS else 0.0
