# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure one robot's SLAM: time and memory on recorded logs, and how they grow.

usage: python benchmarks/slam.py [LOG ...]        folders with bag/ (default: the shared logs)

Prints one row per log (milliseconds of CPU per scan on the scan path and beside it, times real
time, peak memory) and the time of one loop update against the number of views, with the fitted
exponent. Asserts nothing.
"""

import os
from pathlib import Path
import resource
import sys
import time

for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(name, '1')

import numpy as np  # noqa: E402, I100
from somfusion_ros.geometry import between  # noqa: E402
from somfusion_ros.slam.ekf import DelayedStateEkf  # noqa: E402
from somfusion_ros.slam.motion import OdometryBuffer  # noqa: E402
from somfusion_ros.slam.relation import Relation  # noqa: E402
from somfusion_ros.slam.slam import Slam  # noqa: E402
from somfusion_ros.tools.bags import open_log  # noqa: E402
from somfusion_ros.tools.robot_run import paired  # noqa: E402

SHARED = Path(os.environ.get('SOMFUSION_DATA', Path(__file__).resolve().parents[2] / 'shared'))


def measure(bag: Path) -> str:
    """Replay one bag, loops beside the scan path; give its row of the table."""
    log, slam, buffer = open_log(bag), Slam(background=True), OdometryBuffer()
    path, beside, first, stamp = [], [], None, 0.0
    begin = time.process_time()
    for scan, odometry in paired(log, buffer, {}):
        first, stamp = scan.stamp if first is None else first, scan.stamp
        t0 = time.process_time()
        slam.process(scan, odometry)
        t1 = time.process_time()
        buffer.lag = slam.odometry_lag
        while slam.work():
            pass
        path.append(t1 - t0)
        beside.append(time.process_time() - t1)
    t0 = time.process_time()
    slam.grid()
    drawn, total = time.process_time() - t0, time.process_time() - begin
    ms, memory = 1e3 * np.array(path), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (f'{len(ms):6} {len(slam.views()[0]):6} {np.median(ms):7.1f} '
            f'{np.percentile(ms, 99):7.1f} {1e3 * np.mean(beside):8.1f} {1e3 * drawn:8.0f} '
            f'{(stamp - first) / total:9.0f} {memory:8.0f}')


def growth(counts: tuple[int, ...] = (250, 500, 1000, 2000, 4000)) -> None:
    """Print the time of a new view and of a loop update against the number of views."""
    rng, Q, ekf = np.random.default_rng(0), np.diag([0.02, 0.02, 0.01]) ** 2, DelayedStateEkf()
    updates = []
    print('\n views  new view ms  loop update ms')
    for count in counts:
        t0 = time.process_time()
        added = count - ekf.n
        while ekf.n < count:
            ekf.augment(np.array([0.4, 0.0, 0.05]), Q)
        t1 = time.process_time()
        for _ in range(5):
            i, j = sorted(rng.choice(count, 2, replace=False))
            ekf.update(Relation(i, j, between(ekf.poses[i], ekf.poses[j]), Q))
        updates.append((time.process_time() - t1) / 5)
        print(f'{count:6} {1e3 * (t1 - t0) / added:12.2f} {1e3 * updates[-1]:15.1f}')
    exponent = np.polyfit(np.log(counts), np.log(updates), 1)[0]
    print(f'a loop update grows with the number of views to the power {exponent:.2f}')


def main() -> None:
    """Measure the named logs, each in a process of its own so that memory is its own."""
    if len(sys.argv) == 3 and sys.argv[1] == '--one':
        print(f'{Path(sys.argv[2]).name:18}', measure(Path(sys.argv[2]) / 'bag'), flush=True)
        return
    logs = sys.argv[1:] or [str(p) for p in sorted((SHARED / 'data' / 'logs').glob('*'))]
    print('log                 scans  views  median     p99   beside  drawn ms  x real   MB'
          '    (ms of CPU per scan)', flush=True)
    for log in logs:
        os.spawnv(os.P_WAIT, sys.executable, [sys.executable, __file__, '--one', log])
    growth()


if __name__ == '__main__':
    main()
