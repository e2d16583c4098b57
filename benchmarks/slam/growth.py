# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how one robot's SLAM grows: with the number of views, and with the size of the map.

usage: python -m benchmarks.slam.growth

Prints the time of a new view and of a loop update against the number of views, with the fitted
exponent; and, for a drive of 760 m around a block whose map has 4000 x 4000 cells, the longest
step of the scan path while another thread closes loops and draws that map over and over.
Asserts nothing.
"""

from threading import Event, Thread
import time

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box, polygon
from somfusion_ros.simulation.laser import Scene
from somfusion_ros.simulation.trial import SICK, simulate_trial, Trial
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.slam import Slam

SIDE, WIDTH = 190.0, 6.0   # [m] of the square that is driven, and of its street


def growth(counts: tuple[int, ...] = (250, 500, 1000, 2000, 4000, 5000)) -> None:
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
            ekf.update(Constraint(i, j, between(ekf.poses[i], ekf.poses[j]), Q))
        updates.append((time.process_time() - t1) / 5)
        print(f'{count:6} {1e3 * (t1 - t0) / added:12.2f} {1e3 * updates[-1]:15.1f}')
    exponent = np.polyfit(np.log(counts), np.log(updates), 1)[0]
    print(f'a loop update grows with the number of views to the power {exponent:.2f}')


def around_a_block(rng: np.random.Generator) -> Trial:
    """Drive once around a square street between two rows of houses, with things on its way."""
    near, far = -0.5 * WIDTH, SIDE + 0.5 * WIDTH
    parts = [polygon([(near, near), (far, near), (far, far), (near, far)]),
             polygon([(-near, -near), (SIDE + near, -near), (SIDE + near, SIDE + near),
                      (-near, SIDE + near)])]
    for along in np.arange(8.0, SIDE - 8.0, 5.0):
        for x, y in ((along, 0), (SIDE, along), (along, SIDE), (0, along)):
            dx, dy = rng.choice([-1.0, 1.0], 2) * rng.uniform(0.25, 0.45, 2) * WIDTH
            parts.append(box(x + dx, y + dy, *rng.uniform(0.3, 1.0, 2)))
    route = np.array([(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE), (0, 0), (10, 0)], float)
    stamps, poses = drive.follow(route, 0.0, 2.0, 600.0)
    scene = Scene(np.concatenate(parts))
    return simulate_trial(lambda t: scene, stamps, poses, SICK, rng)


def steps(trial: Trial, beside: bool) -> tuple[Array, Slam, list[float]]:
    """
    Time the steps of the scan path [s], and drawing the map [s], over a drive's second half.

    With beside, another thread closes loops and draws the map all the time; else no one does.
    By the second half the map has its full size.
    """
    slam, buffer, took, drawn, end = Slam(background=True), OdometryBuffer(), [], [], Event()

    def work() -> None:
        while not end.is_set():
            while slam.work():
                pass
            started = time.perf_counter()
            slam.grid()
            if 2 * len(took) > len(trial.scans):
                drawn.append(time.perf_counter() - started)

    worker = Thread(target=work)
    if beside:
        worker.start()
    for sample in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        buffer.add(*sample)
    for scan in trial.scans:
        odometry = buffer.at(scan.stamp)
        if odometry is not None:
            started = time.perf_counter()
            slam.process(scan, odometry)
            took.append(time.perf_counter() - started)
    end.set()
    if beside:
        worker.join()
    return np.array(took[len(took) // 2:]), slam, drawn


def large_map() -> None:
    """Print the scan path's steps, by the clock, alone and beside a map of 4000 x 4000 cells."""
    trial = around_a_block(np.random.default_rng(0))
    print('\nscan path by the clock      steps  median     p99  longest ms')
    for beside in (False, True):
        took, slam, drawn = steps(trial, beside)
        ms = 1e3 * took
        print(f'{"beside loops and drawing" if beside else "alone":26} {len(ms):6} '
              f'{np.median(ms):7.1f} {np.percentile(ms, 99):7.1f} {ms.max():8.1f}', flush=True)
    cells = slam.grid().evidence.shape
    print(f'map of {cells[1]} x {cells[0]} cells, {len(slam.views()[0])} views, '
          f'{slam.counters["loops_accepted"]} loops, drawn {len(drawn)} times: '
          f'median {np.median(drawn):.2f} s, longest {max(drawn):.2f} s')


if __name__ == '__main__':
    growth()
    large_map()
