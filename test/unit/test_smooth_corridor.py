# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot whose wheels slip where walls fix the pose in two directions only is not lost."""

from helpers import fake_scan
import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam

RADIUS, HALF = 8.0, 1.0      # [m] of a round corridor, half its width
STEP = compose((0.1, 0.0, 0.0), (0.0, 0.0, 0.1 / RADIUS))
SCANS, FIRST, EVERY = 40, 24, 6          # scans; the first that follows a slip, and between two


def round_walls() -> Array:
    """Return the walls (N, 4) of three quarters of it, about the origin."""
    angle = np.linspace(-1.0, 1.5, 60)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([np.hstack([r * ring[:-1], r * ring[1:]])
                           for r in (RADIUS - HALF, RADIUS + HALF)])


@pytest.mark.parametrize('seed', [1, 2])
def test_a_slip_in_a_smooth_corridor_does_not_make_a_robot_lost(seed: int) -> None:
    """Matches that differ only along it are one: none of them says where along it is."""
    walls, slam, rng = round_walls(), Slam(), np.random.default_rng(seed)
    true, told = np.array([RADIUS, 0.0, 0.5 * np.pi]), np.zeros(3)
    for k in range(SCANS):
        scan = fake_scan(walls, true, 0.2 * k, beams=181, range_max=6.0, noise=0.01, rng=rng)
        step = slam.process(scan, Odometry(0.2 * k, told, np.zeros(3)))
        assert step.reason != 'lost', k
        slips = k >= FIRST and k % EVERY == 0
        slip = (rng.uniform(0.0, 0.35), 0.0, rng.choice([-0.5, 0.5])) if slips else np.zeros(3)
        true, told = compose(true, STEP), compose(told, compose(STEP, slip))
