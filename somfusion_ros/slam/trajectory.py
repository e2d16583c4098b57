# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path between the scans, in the shape that the odometry gives it."""

import numpy as np
from somfusion_ros.geometry import Array, between, compose

LARGEST = (0.3, 0.3)   # [m] [rad] odometry that misses a step by more does not shape it


def with_odometry(stamps: Array, poses: Array, known: Array, sample_stamps: Array,
                  samples: Array) -> tuple[Array, Array]:
    """
    Insert the odometry's samples between the scans' poses.

    Between two scans the path follows the odometry, and what the odometry misses of the step is
    spread evenly over the time.

    Parameters
    ----------
    stamps, poses : (n,) [s] rising and (n, 3) T_map_base of the scans
    known : (n, 3) T_odom_base at the scans
    sample_stamps, samples : (m,) [s] rising and (m, 3) T_odom_base
    """
    at = np.asarray(sample_stamps, dtype=float)
    after = np.searchsorted(stamps, at)
    inside = (after > 0) & (after < len(stamps))
    inside[inside] &= stamps[after[inside]] != at[inside]
    at, after, sample = at[inside], after[inside], np.asarray(samples)[inside]
    if not len(at):
        return stamps, poses
    a, b = after - 1, after
    missed = between(between(known[a], known[b]), between(poses[a], poses[b]))
    fair = (np.hypot(missed[:, 0], missed[:, 1]) < LARGEST[0]) & (abs(missed[:, 2]) < LARGEST[1])
    share = (at - stamps[a]) / (stamps[b] - stamps[a])
    path = compose(compose(poses[a], between(known[a], sample)), missed * share[:, None])
    every = np.concatenate([stamps, at[fair]])
    order = np.argsort(every, kind='stable')
    return every[order], np.concatenate([poses, path[fair]])[order]
