# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a laser sees among line segments."""

import numpy as np
from somfusion_ros.geometry import Array


def raycast(segments: Array, origins: Array, angles: Array) -> tuple[Array, Array]:
    """
    Find where rays first meet a segment.

    Parameters
    ----------
    segments : (S, 4) x0, y0, x1, y1 [m]
    origins : (B, 2) start of every ray [m]
    angles : (B,) direction of every ray [rad]

    Returns
    -------
    ranges : (B,) [m], inf where a ray meets nothing
    incidence : (B,) |cos| of the angle between ray and surface normal, 1 where it meets nothing

    """
    direction = np.column_stack([np.cos(angles), np.sin(angles)])
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    offset = start[None] - origins[:, None]                                       # (B, S, 2)
    cross = direction[:, None, 0] * along[None, :, 1] - direction[:, None, 1] * along[None, :, 0]
    with np.errstate(divide='ignore', invalid='ignore'):
        distance = (offset[..., 0] * along[:, 1] - offset[..., 1] * along[:, 0]) / cross
        share = (offset[..., 0] * direction[:, None, 1]
                 - offset[..., 1] * direction[:, None, 0]) / cross
        met = (distance > 0.0) & (share >= 0.0) & (share <= 1.0)
    distance = np.where(met, distance, np.inf)
    nearest = distance.argmin(1)
    rows = np.arange(len(angles))
    ranges = distance[rows, nearest]
    incidence = np.abs(cross[rows, nearest]) / np.hypot(*along[nearest].T)
    return ranges, np.where(np.isfinite(ranges), incidence, 1.0)
