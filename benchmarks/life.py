# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure a robot's whole life: what its SLAM costs, and how good it is, after hours in one place.

usage: python -m benchmarks.life [HOURS [WORLD [STATE]]]      default 2 office
       WORLD: office (seven rooms, all visited alike), rooms (one of five rarely visited), or
              town (streets of 500 x 500 m; ten kilometres take 3 hours)
       STATE: a file to write the state to at the end, and to go on from

Prints a row per simulated half-hour: hours; kilometres; views; scans kept for the map; memory
[MB] that the SLAM holds, and of the process; milliseconds of CPU per scan on the scan path, as the
mean and the longest, and beside it (loops); of a redraw as a node does it, as the mean and the
longest of one each three minutes; median and largest error [m] of the pose told; mean
normalised estimation error squared of the pose (3 if honest). Lasers of 2.5 or 6 scans a second,
so that a day takes 20 minutes to compute. With a STATE, at last its length, and
the seconds of CPU to read it, to be ready for the first scan, and to draw it. Asserts nothing.
"""

from collections import deque
from dataclasses import dataclass, field, replace
import os
import sys
import time
from types import FunctionType, ModuleType
from typing import Any

from benchmarks.data.errands import World, WORLDS
from benchmarks.memory import held_bytes
import numpy as np
from somfusion_ros.geometry import Array, between, compose, difference
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.trial import ODOMETRY_EVERY, SICK, simulate_trial
from somfusion_ros.slam.checkpoint_file import CheckpointFile, load_checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.slam import Slam

ROW = 0.5         # [h] of a row, about
DRIVE = 0.05      # [h] that are simulated at once
DRAWN_AT_ONCE = 1000   # moved scans of a redraw, as in ros/slam/pipeline.py
TURNS = 0.8       # of its top speed, on the way, for what a robot loses in turns
PAUSE = 0.5       # [s] between two rows
TRAVEL = 0.16     # [m] between two scans


@dataclass
class Told:
    """What a row is made of: CPU time [s] per scan and redraw, error [m], NEES per scan."""

    path: list[float] = field(default_factory=list)
    beside: list[float] = field(default_factory=list)
    drawn: list[float] = field(default_factory=list)
    error: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)


class Life:
    """One robot that drives on and on."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        self.world, self._rng, self._ways = world, rng, world.ways(rng)
        self.first = np.array([*next(self._ways), 0.0])
        self._pose, self._odometry = self.first, np.zeros(3)
        self.clock, self.metres = 0.0, 0.0
        self.laser = replace(SICK, period=TRAVEL / world.speed)
        self._wheels = drive.real_wheels(0.02, rng)
        self.slam = Slam(SlamConfig(resolution=world.resolution), background=True)

    def _route(self, hours: float) -> Array:
        """Return way points (K, 2) [m] from where the robot stands, for about some hours."""
        points, length = [self._pose[:2]], 0.0
        while length < 3600.0 * hours * TURNS * self.world.speed:
            points.append(next(self._ways))
            length += float(np.hypot(*(points[-1] - points[-2])))
        return np.array(points)

    def live(self, hours: float = ROW) -> Told:
        """Live for some time; return what it took and how far the SLAM was off."""
        told, end = Told(), self.clock + 3600.0 * hours
        while self.clock < end:
            self._drive(told)
            t0 = time.process_time()
            self.slam.grid(DRAWN_AT_ONCE)
            told.drawn.append(time.process_time() - t0)
        return told

    def _drive(self, told: Told, hours: float = DRIVE) -> None:
        """Drive for some time; add what it took and how far the SLAM was off."""
        stamps, poses = drive.follow(self._route(hours), float(self._pose[2]), self.world.speed,
                                     np.inf)
        whole = slice((len(stamps) - 1) // ODOMETRY_EVERY * ODOMETRY_EVERY + 1)
        stamps, poses = stamps[whole], poses[whole]
        trial = simulate_trial(
            lambda t: self.world.around(drive.at(stamps, poses, np.array([t]))[0]), stamps, poses,
            self.laser, self._rng, self._wheels)
        begin, clock = self._odometry, self.clock + PAUSE
        at = np.array([scan.stamp for scan in trial.scans])
        odometry = compose(begin, between(trial.odometry[0], drive.at(
            trial.odometry_stamps, trial.odometry, at)))
        truth = between(self.first, drive.at(stamps, poses, at))
        for scan, pose, true in zip(trial.scans, odometry, truth, strict=True):
            self._step(replace(scan, stamp=clock + scan.stamp), pose, true, told)
        self._odometry = compose(begin, between(trial.odometry[0], trial.odometry[-1]))
        self._pose, self.clock = poses[-1], clock + float(stamps[-1])
        self.metres += float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())

    def _step(self, scan: Scan, odometry: Array, truth: Array, told: Told) -> None:
        """Process one scan, taken where the wheels have the robot, and where it truly was."""
        t0 = time.process_time()
        step = self.slam.process(scan, Odometry(scan.stamp, odometry, np.zeros(3)))
        t1 = time.process_time()
        while self.slam.work():
            pass
        told.path.append(t1 - t0)
        told.beside.append(time.process_time() - t1)
        e = difference(np.array(step.pose), truth)
        told.error.append(float(np.hypot(e[0], e[1])))
        if step.covariance[2, 2] > 1e-12:
            told.nees.append(float(e @ np.linalg.solve(step.covariance, e)))


def size_of(thing: Any, seen: set[int]) -> int:
    """Return the bytes of the arrays, lists and objects that are reached from a thing."""
    if id(thing) in seen or isinstance(thing, (type, ModuleType, FunctionType)):
        return 0
    seen.add(id(thing))
    size, parts = sys.getsizeof(thing), list[Any]()
    if isinstance(thing, np.ndarray):
        parts = [thing.base]
    elif isinstance(thing, dict):
        parts = [*thing.keys(), *thing.values()]
    elif isinstance(thing, (list, tuple, set, frozenset, deque)):
        parts = list(thing)
    elif hasattr(thing, '__dict__'):
        parts = [vars(thing)]
    parts += [getattr(thing, name) for kind in type(thing).__mro__
              for name in getattr(kind, '__slots__', ()) if hasattr(thing, name)]
    return size + sum(size_of(part, seen) for part in parts)


def restart(life: Life, path: str) -> None:
    """Write the state, go on from it, and print what that takes."""
    file = CheckpointFile(path)
    file.save(life.slam.checkpoint())
    file.close()
    times = [time.process_time()]
    checkpoint = load_checkpoint(path)
    times.append(time.process_time())
    life.slam = Slam(life.slam.config, background=True, checkpoint=checkpoint)
    times.append(time.process_time())
    life.slam.grid()
    times.append(time.process_time())
    read, ready, drawn = np.diff(times)
    print(f'state of {os.path.getsize(path) / 2 ** 20:.0f} MB: read in {read:.2f} s, ready for a '
          f'scan {ready:.2f} s later, drawn anew in {drawn:.1f} s')


def row(life: Life, told: Told) -> str:
    """Return a line of what some time took."""
    state, held = life.slam.checkpoint(), size_of(life.slam, set()) / 2 ** 20
    path, drawn = 1e3 * np.array(told.path), 1e3 * np.array(told.drawn)
    showing = sum(len(cloud) > 0 for cloud in state.clouds)
    return (f'{life.clock / 3600.0:6.2f} {life.metres / 1e3:6.2f} {showing:6} '
            f'{len(state.scans):6} {held:6.1f} {held_bytes() / 2 ** 20:6.0f} {path.mean():8.2f} '
            f'{path.max():8.0f} {1e3 * np.mean(told.beside):10.2f} {drawn.mean():8.0f} '
            f'{drawn.max():8.0f} {np.median(told.error):7.3f} {max(told.error):8.3f} '
            f'{np.mean(told.nees):6.2f}')


def main() -> None:
    """Print a row per half-hour."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 2.0
    world = WORLDS[sys.argv[2] if len(sys.argv) > 2 else 'office']()
    life = Life(world, np.random.default_rng(16))
    print(' hours     km  views  scans   held     MB  ms path  longest  ms beside ms drawn'
          '  longest   error  largest   NEES')
    while life.clock < 3600.0 * hours:
        print(row(life, life.live()), flush=True)
    if len(sys.argv) > 3:
        restart(life, sys.argv[3])


if __name__ == '__main__':
    main()
