# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories in TUM text: stamp x y z qx qy qz qw."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import Array
from somfusion_ros.whole_files import write_text


def write_tum(path: Path, stamps: ArrayLike, poses: ArrayLike) -> None:
    """Write stamps (N,) [s] and poses (N, 3) x [m], y [m], theta [rad]."""
    poses = np.asarray(poses, dtype=float).reshape(-1, 3)
    half = 0.5 * poses[:, 2]
    write_text(path, ''.join(
        f'{t:.9f} {x:.6f} {y:.6f} 0.000000 0.000000 0.000000 {qz:.9f} {qw:.9f}\n'
        for t, (x, y, _), qz, qw in zip(np.ravel(stamps), poses, np.sin(half), np.cos(half))))


def read_tum(path: Path) -> tuple[Array, Array]:
    """Read stamps (N,) [s] and planar poses (N, 3) of a TUM file; N may be 0."""
    lines = [line for line in path.read_text().splitlines() if line.strip()
             and not line.startswith('#')]
    rows = np.array([line.split() for line in lines], dtype=float).reshape(-1, 8)
    return rows[:, 0], np.column_stack([rows[:, 1:3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])])
