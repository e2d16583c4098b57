# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure a robot's whole life: what its SLAM costs, and how good it is, after hours in one place.

usage: python benchmarks/life.py [HOURS [WORLD [STATE]]]      default 2 office
       WORLD: office (seven rooms, all visited alike) or rooms (one of five rarely visited)
       STATE: a file to write the state to at the end, and to go on from

Prints a row per simulated quarter of an hour: hours; views; scans kept for the map; memory [MB] of
the process; milliseconds of CPU per scan on the scan path and beside it (loops); of one redraw;
median and largest error [m] of the pose told; mean normalised estimation error squared of the
pose (3 if honest). With a STATE, at last its length, and the seconds of CPU to read it and to
process the first scan. Asserts nothing.
"""

import os
import resource
import sys
import time

for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(name, '1')

import numpy as np  # noqa: E402, I100
from somfusion_ros.geometry import Array, between, difference  # noqa: E402
from somfusion_ros.simulation import drive, floor_plan  # noqa: E402
from somfusion_ros.simulation.laser import Scene  # noqa: E402
from somfusion_ros.simulation.trial import SICK, simulate_trial  # noqa: E402
from somfusion_ros.slam.checkpoint_file import CheckpointFile, load_checkpoint  # noqa: E402
from somfusion_ros.slam.motion import Odometry  # noqa: E402
from somfusion_ros.slam.slam import Slam  # noqa: E402

QUARTER = 900.0   # [s] of a row
SPEED = 0.4       # [m/s]
# Doors and middles of the seven rooms of the office, and the corridor between them.
CORRIDOR = 5.2
ROOMS = [(2.6, 6, 2.0, 8.0), (5.4, 6, 6.0, 8.0), (11.3, 6, 10.5, 8.0), (14.2, 6, 15.0, 8.0),
         (4.4, 4.4, 3.0, 2.5), (7.4, 4.4, 8.0, 2.5), (13.1, 4.4, 13.0, 2.5)]


def route(rng: np.random.Generator, world: str, start: Array, length: float) -> Array:
    """Way points (K, 2) [m] through rooms drawn at random, of a length [m] at least."""
    points = [start, np.array([start[0], CORRIDOR])]
    while np.hypot(*np.diff(points, axis=0).T).sum() < length:
        if world == 'office':
            room = ROOMS[rng.integers(len(ROOMS))]
        else:
            room = ROOMS[rng.choice(5, p=[0.25, 0.25, 0.25, 0.24, 0.01])]
        door, _, x, y = room
        points += [np.array(p) for p in ((door, CORRIDOR), (door, y), (x, y), (door, y),
                                         (door, CORRIDOR))]
    return np.array(points)


class Life:
    """One robot that drives on and on, quarter by quarter."""

    def __init__(self, world: str, rng: np.random.Generator) -> None:
        self._world, self._rng, self._plan = world, rng, floor_plan.office()
        self._pose, self._odometry = np.array([2.0, CORRIDOR, 0.0]), np.zeros(3)
        self._first, self._clock = self._pose, 0.0
        self._wheels = drive.real_wheels(0.02, rng)
        self.slam = Slam(background=True)

    def quarter(self) -> dict[str, Array]:
        """Drive for a quarter of an hour; return what it took and how far the SLAM was off."""
        rng, scene = self._rng, Scene(self._plan.segments)
        way = route(rng, self._world, self._pose[:2], QUARTER * SPEED)
        stamps, poses = drive.follow(way, float(self._pose[2]), SPEED, QUARTER)
        trial = simulate_trial(lambda t: scene, stamps, poses, SICK, rng, self._wheels)
        told: dict[str, list[float]] = {name: [] for name in ('path', 'beside', 'error', 'nees')}
        begin = self._odometry
        for scan in trial.scans[::2]:
            k = int(np.searchsorted(trial.odometry_stamps, scan.stamp))
            if k >= len(trial.odometry_stamps):
                break
            self._step(scan, k, trial, begin, poses, told)
        self._pose, self._clock = poses[-1], self._clock + stamps[-1] + 0.1
        return {name: np.array(values) for name, values in told.items()}

    def _step(self, scan: object, k: int, trial: object, begin: Array, poses: Array,
              told: dict[str, list[float]]) -> None:
        """Process one scan."""
        from dataclasses import replace

        from somfusion_ros.geometry import compose
        at = drive.at(trial.odometry_stamps, trial.odometry, np.array([scan.stamp]))[0]
        pose = compose(begin, between(trial.odometry[0], at))
        self._odometry = pose
        stamp = self._clock + scan.stamp
        t0 = time.process_time()
        step = self.slam.process(replace(scan, stamp=stamp), Odometry(stamp, pose, np.zeros(3)))
        t1 = time.process_time()
        while self.slam.work():
            pass
        told['path'].append(t1 - t0)
        told['beside'].append(time.process_time() - t1)
        truth = between(self._first, drive.at(trial.stamps, poses, np.array([scan.stamp]))[0])
        e = difference(np.array(step.pose), truth)
        told['error'].append(float(np.hypot(e[0], e[1])))
        if step.covariance[2, 2] > 1e-12:
            told['nees'].append(float(e @ np.linalg.solve(step.covariance, e)))


def memory() -> float:
    """Memory [MB] that the process holds now."""
    with open('/proc/self/statm') as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2 ** 20


def restart(life: Life, path: str) -> None:
    """Write the state, go on from it, and print what that takes."""
    file = CheckpointFile(path)
    file.save(life.slam.checkpoint())
    file.close()
    t0 = time.process_time()
    checkpoint = load_checkpoint(path)
    t1 = time.process_time()
    life.slam = Slam(background=True, checkpoint=checkpoint)
    t2 = time.process_time()
    print(f'state of {os.path.getsize(path) / 2 ** 20:.0f} MB: read in {t1 - t0:.2f} s, first '
          f'scan {t2 - t1:.2f} s later')


def main() -> None:
    """Print a row per quarter of an hour."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 2.0
    life = Life(sys.argv[2] if len(sys.argv) > 2 else 'office', np.random.default_rng(16))
    print(' hours  views  scans     MB   ms path  ms beside  redraw ms   error  largest   NEES')
    for quarter in range(1, round(hours * 4) + 1):
        told = life.quarter()
        t0 = time.process_time()
        life.slam.grid()
        drawn = time.process_time() - t0
        graph = life.slam._map.graph
        print(f'{quarter / 4:6.2f} {len(graph.clouds):6} {len(graph.scans):6} {memory():6.0f} '
              f'{1e3 * told["path"].mean():9.2f} {1e3 * told["beside"].mean():10.2f} '
              f'{1e3 * drawn:10.0f} {np.median(told["error"]):7.3f} {told["error"].max():8.3f} '
              f'{told["nees"].mean():6.2f}', flush=True)
    if len(sys.argv) > 3:
        restart(life, sys.argv[3])


if __name__ == '__main__':
    main()
