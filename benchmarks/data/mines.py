# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Convert a log of the Mines ParisTech rover (exp1.dat, exp2.dat) into a bag.

usage: python -m benchmarks.data.mines EXP.dat OUT

Writes OUT/bag with `/scan`, `/odom`, `/joint_states` (two encoders, rad) and `/tf_static`. A line
of the log holds a stamp [us], the encoders [ticks] in columns 2 and 3, and 682 ranges [mm] of a
Hokuyo URG-04LX from column 24 on, of which 70 at either end look at the rover itself.
"""

from pathlib import Path
import sys

import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.wheel_odometry import WheelOdometry

BEAMS, HIDDEN, FIRST = 682, 70, 24          # beams, those at either end that see the rover, column
INCREMENT = np.radians(240.0) / (BEAMS - 1)   # [rad]
T_BASE_LASER = Pose(0.145, 0.0, 0.0)        # [m]
RADIUS, SEPARATION = 0.077, 0.33            # [m] of the wheels, known to about 3 %
TICK = np.pi / 2000.0                       # [rad]
MIN_RANGE, MAX_RANGE = 0.06, 4.0            # [m]; 0 means no return


def read_mines(path: Path) -> tuple[Array, Array, Array]:
    """Return stamps (N,) [s], encoders (N, 2) [rad] and ranges (N, 542) [m]."""
    rows = np.array([line.split()[:FIRST + BEAMS] for line in path.read_text().splitlines()
                     if line.strip()], float)
    if rows.ndim != 2 or rows.shape[1] < FIRST + BEAMS:
        raise ValueError(f'{path}: lines of {FIRST + BEAMS} numbers are needed')
    ranges = rows[:, FIRST + HIDDEN:FIRST + BEAMS - HIDDEN] * 1e-3
    return rows[:, 0] * 1e-6, rows[:, 2:4] * TICK, ranges


def write_log(log: Path, out: Path) -> int:
    """Write OUT/bag; return the number of scans."""
    stamps, encoders, ranges = read_mines(log)
    wheels = WheelOdometry(RADIUS, SEPARATION)
    out.mkdir(parents=True, exist_ok=True)
    with BagWriter(out / 'bag') as bag:
        bag.mount(stamps[0], T_BASE_LASER)
        for stamp, angles, beams in zip(stamps, encoders, ranges, strict=True):
            bag.wheels(stamp, angles)
            bag.odometry(stamp, wheels.update(*angles))
            bag.scan(Scan(stamp=stamp, ranges=beams,
                          angle_min=-0.5 * INCREMENT * (beams.size - 1),
                          angle_increment=INCREMENT, range_min=MIN_RANGE, range_max=MAX_RANGE,
                          T_base_laser=T_BASE_LASER))
    return len(stamps)


if __name__ == '__main__':
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    print(f'{write_log(Path(sys.argv[1]), Path(sys.argv[2]))} scans')
