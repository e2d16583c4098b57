# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Convert a log in CARMEN's text format into what `somfusion replay` reads.

usage: python -m benchmarks.data.carmen LOG OUT [--relations FILE] [--corrected LOG]
       [--max-range 80]

Writes OUT/bag with `/scan`, `/odom` and `/tf_static`; with --relations (Kuemmerle et al. 2009)
OUT/relations.txt; with --corrected, the same log after a good SLAM, OUT/reference.tum. Logs may
be gzipped. Both kinds of laser lines are read: FLASER, and ROBOTLASER1 of newer logs.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
import gzip
from pathlib import Path

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.slam.scan import Scan

MIN_RANGE, MAX_RANGE = 0.05, 80.0   # [m] of a SICK LMS


@dataclass(frozen=True, eq=False)
class LaserLine:
    """One scan of a log: stamp [s], ranges (N,) [m], first angle and step [rad], both poses."""

    stamp: float
    ranges: Array
    angle_min: float
    angle_increment: float
    max_range: float
    T_odom_laser: Pose
    T_odom_base: Pose


@dataclass(frozen=True)
class OdometryLine:
    """One pose of the wheels: stamp [s], T_odom_base."""

    stamp: float
    T_odom_base: Pose


def read_carmen(path: Path, max_range: float = MAX_RANGE) -> Iterator[LaserLine | OdometryLine]:
    """Yield the laser and odometry lines of a log; ValueError names a line that is broken."""
    opened = gzip.open if path.suffix == '.gz' else open
    with opened(path, 'rt', encoding='ascii', errors='replace') as file:
        for number, line in enumerate(file, start=1):
            words = line.split()
            try:
                if words and words[0] == 'FLASER':
                    yield _flaser(words, max_range)
                elif words and words[0] == 'ROBOTLASER1':
                    yield _robotlaser(words)
                elif words and words[0] == 'ODOM':
                    yield OdometryLine(float(words[-3]), _pose(words[1:4]))
            except (IndexError, ValueError) as error:
                raise ValueError(f'{path}, line {number}: {error}') from error


def _flaser(words: list[str], max_range: float) -> LaserLine:
    """Read FLASER n ranges laser_x y theta base_x y theta stamp host logger_stamp."""
    count = int(words[1])
    ranges, rest = np.array(words[2:2 + count], float), words[2 + count:]
    # Half a circle; an odd number of beams has one at each end of it.
    return LaserLine(float(rest[-3]), ranges, -np.pi / 2.0, np.pi / (count - count % 2),
                     max_range, _pose(rest[:3]), _pose(rest[3:6]))


def _robotlaser(words: list[str]) -> LaserLine:
    """
    Read ROBOTLASER1.

    type, first angle, field of view, step, max_range, accuracy, remission mode, n, ranges,
    m, remissions, laser pose, base pose, five numbers more, stamp, host, logger's stamp.
    """
    angle_min, _, increment, max_range = map(float, words[2:6])
    count = int(words[8])
    ranges, rest = np.array(words[9:9 + count], float), words[9 + count:]
    rest = rest[1 + int(rest[0]):]
    return LaserLine(float(rest[-3]), ranges, angle_min, increment, max_range, _pose(rest[:3]),
                     _pose(rest[3:6]))


def _pose(words: list[str]) -> Pose:
    """Read x y theta."""
    if len(words) != 3:
        raise ValueError('a pose is cut short')
    return Pose.from_array(map(float, words))


def write_log(log: Path, out: Path, max_range: float = MAX_RANGE) -> int:
    """Write OUT/bag; return the number of scans."""
    lines = list(read_carmen(log, max_range))
    lasers = [line for line in lines if isinstance(line, LaserLine)]
    if not lasers:
        raise ValueError(f'{log}: holds no FLASER and no ROBOTLASER1 line')
    T_base_laser = Pose.from_array(between(lasers[0].T_odom_base, lasers[0].T_odom_laser))
    out.mkdir(parents=True, exist_ok=True)
    with BagWriter(out / 'bag') as bag:
        bag.mount(lasers[0].stamp, T_base_laser)
        for line in sorted(lines, key=lambda line: line.stamp):
            bag.odometry(line.stamp, line.T_odom_base)
            if isinstance(line, LaserLine):
                bag.scan(Scan(stamp=line.stamp, ranges=line.ranges, angle_min=line.angle_min,
                              angle_increment=line.angle_increment, range_min=MIN_RANGE,
                              range_max=line.max_range, T_base_laser=T_base_laser))
    return len(lasers)


def write_reference(corrected: Path, mount: LaserLine, out: Path) -> None:
    """Write OUT/reference.tum, T_world_base, of a log whose laser poses are corrected."""
    T_laser_base = inverse(between(mount.T_odom_base, mount.T_odom_laser))
    lasers = [line for line in read_carmen(corrected) if isinstance(line, LaserLine)]
    poses = compose(np.array([line.T_odom_laser for line in lasers]), T_laser_base)
    write_tum(out / 'reference.tum', [line.stamp for line in lasers], poses)


def write_relations(relations: Path, out: Path) -> None:
    """Write OUT/relations.txt, t1 t2 x y theta, of t1 t2 x y z roll pitch yaw."""
    rows = np.atleast_2d(np.loadtxt(relations))
    np.savetxt(out / 'relations.txt', rows[:, [0, 1, 2, 3, 7]], '%.6f', header='t1 t2 x y theta')


def main() -> None:
    """Convert a log."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('log', type=Path)
    parser.add_argument('out', type=Path)
    parser.add_argument('--relations', type=Path)
    parser.add_argument('--corrected', type=Path)
    parser.add_argument('--max-range', type=float, default=MAX_RANGE)
    args = parser.parse_args()
    print(f'{write_log(args.log, args.out, args.max_range)} scans')
    if args.relations:
        write_relations(args.relations, args.out)
    if args.corrected:
        first = next(line for line in read_carmen(args.log) if isinstance(line, LaserLine))
        write_reference(args.corrected, first, args.out)


if __name__ == '__main__':
    main()
