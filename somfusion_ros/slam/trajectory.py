# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path between the scans, in the shape that the odometry gives it."""

import numpy as np

from somfusion_ros.geometry import Array, between, compose

LARGEST = (0.3, 0.3)   # [m] [rad] odometry that misses a step by more does not shape it


def with_odometry(stamps: Array, poses: Array, odometry_stamps: Array, odometry: Array,
                  lag: float = 0.0) -> tuple[Array, Array]:
    """
    Insert the odometry's samples between the scans' poses.

    Between two scans the path follows the odometry, and what the odometry misses of the step is
    spread evenly over the time.

    Parameters
    ----------
    stamps, poses : (n,) [s] rising and (n, 3) T_map_base of the scans
    odometry_stamps, odometry : (m,) [s] rising and (m, 3) T_odom_base
    lag : time [s] to add to a scan's stamp to find its odometry
    """
    at = np.asarray(odometry_stamps, dtype=float) - lag
    after = np.searchsorted(stamps, at)
    inside = (after > 0) & (after < len(stamps))
    inside[inside] &= stamps[after[inside]] != at[inside]
    at, after, sample = at[inside], after[inside], np.asarray(odometry)[inside]
    if not len(at):
        return stamps, poses
    known = _interpolated(stamps + lag, odometry_stamps, odometry)
    a, b = after - 1, after
    missed = between(between(known[a], known[b]), between(poses[a], poses[b]))
    fair = (np.hypot(missed[:, 0], missed[:, 1]) < LARGEST[0]) & (abs(missed[:, 2]) < LARGEST[1])
    share = (at - stamps[a]) / (stamps[b] - stamps[a])
    path = compose(compose(poses[a], between(known[a], sample)), missed * share[:, None])
    every = np.concatenate([stamps, at[fair]])
    order = np.argsort(every, kind='stable')
    return every[order], np.concatenate([poses, path[fair]])[order]


def _interpolated(at: Array, stamps: Array, poses: Array) -> Array:
    """Poses (k, 3) at times (k,), linear between samples and constant beyond the ends."""
    heading = np.unwrap(np.asarray(poses)[:, 2])
    return np.column_stack([np.interp(at, stamps, column)
                            for column in (*np.asarray(poses)[:, :2].T, heading)])
