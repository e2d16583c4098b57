# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A small scanning laser like the Hokuyo URG-04LX: 240 degrees, 513 beams, 4.5 m, 10 Hz."""

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.tools.raycast import raycast

BEAMS = 513
ANGLE_MIN, ANGLE_INCREMENT = np.radians(-120.0), np.radians(240.0) / (BEAMS - 1)
RANGE_MIN, RANGE_MAX = 0.06, 4.5              # [m]
PERIOD = 0.1                                  # [s] of one turn of the mirror
TIME_INCREMENT = PERIOD * ANGLE_INCREMENT / (2.0 * np.pi)
MOUNT = Pose(0.145, 0.0, 0.0)                 # T_base_laser
HEIGHT = 0.25                                 # [m] above the base
NOISE, NOISE_PER_METRE = 0.01, 0.005          # [m], [m / m]
DROPOUT, DROPOUT_GRAZING = 0.005, 0.3         # chance of no return
GRAZING = np.cos(np.radians(82.0))


def beam_times() -> Array:
    """Time (B,) [s] of every beam after the first."""
    return TIME_INCREMENT * np.arange(BEAMS)


def measure(segments: Array, poses: Array, rng: np.random.Generator) -> NDArray[np.float32]:
    """
    Ranges (B,) [m] that the laser tells from the base poses (B, 3) at its beams.

    inf where nothing is within reach (REP-117), 0 where the light was lost.
    """
    T_world_laser = compose(poses, MOUNT)
    angles = T_world_laser[:, 2] + ANGLE_MIN + ANGLE_INCREMENT * np.arange(BEAMS)
    near = _within_reach(segments, T_world_laser[:, :2].mean(0))
    true, incidence = raycast(segments[near], T_world_laser[:, :2], angles)
    noise = rng.normal(size=BEAMS)
    chance = rng.uniform(size=BEAMS)
    ranges = true + noise * (NOISE + NOISE_PER_METRE * np.minimum(true, RANGE_MAX))
    lost = chance < np.where(incidence < GRAZING, DROPOUT_GRAZING, DROPOUT)
    ranges = np.where(ranges > RANGE_MAX, np.inf, np.round(ranges, 3))
    return np.where(lost | (ranges < RANGE_MIN), 0.0, ranges).astype(np.float32)


def _within_reach(segments: Array, centre: Array) -> NDArray[np.bool_]:
    """Mask (S,) of the segments that may be nearer than the laser's range."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    share = ((centre - start) * along).sum(1) / np.maximum((along ** 2).sum(1), 1e-12)
    nearest = start + along * np.clip(share, 0.0, 1.0)[:, None]
    reach = np.hypot(*(nearest - centre).T) < RANGE_MAX + 0.5
    if not reach.any():
        reach[0] = True   # a ray needs something to miss
    return reach
