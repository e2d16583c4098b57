# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion simulate`: bags of robots in a floor plan, with the truth beside them."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
import json
from pathlib import Path
import shutil
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.io.console import progress_bar, say
from somfusion_ros.io.errors import InputError
from somfusion_ros.io.result import make_folder, pose_record
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import FloorPlan, PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.wheel_odometry import WheelOdometry
from somfusion_ros.whole_files import write_text

EPOCH = 1000.0             # [s] stamp at which the robots are switched on
ODOMETRY_PERIOD = 0.05     # [s]
JITTER = 0.08              # [m] spread of the way points
TRUTH = 'truth.json'
LASER = Laser()


@dataclass(frozen=True)
class SimulationOptions:
    """
    What to simulate.

    robots, plan (a name of PLANS), seed, duration: longest run [s], None for the plan's own,
    wheel_error: largest share by which wheel radius and separation differ from what the
    odometry believes, storage: mcap or sqlite3.
    """

    robots: int = 2
    plan: str = 'office'
    seed: int = 0
    duration: float | None = None
    wheel_error: float = 0.03
    storage: str = 'mcap'


@dataclass(frozen=True, eq=False)
class Run:
    """One robot's drive: stamps (T,) [s] from 0, true poses (T, 3), encoders (T, 2) [rad]."""

    stamps: Array
    poses: Array
    wheels: Array


def simulate(output: str | Path, options: SimulationOptions | None = None) -> dict[str, Any]:
    """
    Write DIR/robotN/bag and DIR/robotN/reference.tum (T_world_base), and DIR/truth.json.

    The map frame of a robot lies where it starts, as its odometry does. The same seed gives the
    same bags. The truth is written first, so that a simulation that was interrupted can be begun
    again, and no bag lies beside the truth of another one.

    Parameters
    ----------
    output : path
        Folder DIR; made where it is missing.
    options : SimulationOptions, optional
        How many robots, in which plan, for how long, with which errors.

    Returns
    -------
    dict
        What is in truth.json: T_world_map per robot and T_target_source per pair [m, rad].

    Raises
    ------
    InputError
        If a folder of a robot exists that no simulation wrote.
    ValueError
        If an option leaves its range.
    """
    options = options or SimulationOptions()
    if not 0.0 <= options.wheel_error < 0.5:
        raise ValueError(f'wheel error {options.wheel_error} is outside [0, 0.5)')
    plan, folder = PLANS[options.plan](), make_folder(output)
    names = [f'robot{number + 1}' for number in range(options.robots)]
    _clear(folder, names)
    chances = [np.random.default_rng(seed) for seed in
               np.random.SeedSequence(options.seed).spawn(options.robots)]
    runs = {name: drive_robot(plan, number, options, rng)
            for number, (name, rng) in enumerate(zip(names, chances))}
    truth = truth_record({name: Pose.from_array(run.poses[0]) for name, run in runs.items()},
                         options)
    write_text(folder / TRUTH, json.dumps(truth, indent=2) + '\n')
    for (name, run), rng in zip(runs.items(), chances):
        (folder / name).mkdir()
        write_bag(folder / name / 'bag', name, plan, run, options.storage, rng)
        write_tum(folder / name / 'reference.tum', EPOCH + run.stamps[::5], run.poses[::5])
        say(f'{name}: {run.stamps[-1]:.0f} s, '
            f'{np.hypot(*np.diff(run.poses[:, :2], axis=0).T).sum():.1f} m: {folder / name}')
    say(f'truth: {folder / TRUTH}')
    return truth


def drive_robot(plan: FloorPlan, number: int, options: SimulationOptions,
                rng: np.random.Generator) -> Run:
    """Drive one robot along its route."""
    route = plan.route(number)
    route = route + rng.uniform(-JITTER, JITTER, route.shape)
    stamps, poses = drive.follow(route, float(rng.uniform(-np.pi, np.pi)),
                                 float(rng.uniform(0.42, 0.5)),
                                 options.duration or plan.duration)
    wheels = drive.real_wheels(options.wheel_error, rng)
    return Run(stamps, poses, drive.encoders(poses, wheels, rng))


def write_bag(folder: Path, name: str, plan: FloorPlan, run: Run, storage: str,
              rng: np.random.Generator) -> None:
    """Write what the robot's sensors tell, in the order of time."""
    with BagWriter(folder, storage) as bag, \
            progress_bar(name, int(run.stamps[-1] / LASER.period) + 1, 'scan') as bar:
        bag.mount(EPOCH, LASER.mount, LASER.height)
        scans = scans_of(plan, run, rng)
        scan = next(scans, None)
        for stamp, pose, twist, wheels in odometry_of(run):
            bag.wheels(stamp, wheels)
            bag.odometry(stamp, pose, twist)
            while scan is not None and scan.stamp <= stamp:
                bag.scan(scan, LASER.period)
                bar.update()
                scan = next(scans, None)


def odometry_of(run: Run) -> Iterator[tuple[float, Array, Array, Array]]:
    """Yield stamp, T_odom_base, twist and wheel positions, by the nominal wheels."""
    wheels = WheelOdometry(drive.NOMINAL.left, drive.NOMINAL.separation)
    every, last = round(ODOMETRY_PERIOD / drive.STEP), np.zeros(3)
    for stamp, positions in zip(run.stamps[::every], run.wheels[::every]):
        pose = np.asarray(wheels.update(*positions))
        yield EPOCH + stamp, pose, between(last, pose) / (every * drive.STEP), positions
        last = pose


def scans_of(plan: FloorPlan, run: Run, rng: np.random.Generator) -> Iterator[Scan]:
    """Yield the scans; the robot moves on while the mirror turns."""
    beams, scene = LASER.beam_times(), Scene(plan.segments)
    for start in np.arange(0.0, run.stamps[-1] - LASER.period, LASER.period):
        poses = drive.at(run.stamps, run.poses, start + beams)
        yield LASER.scan(EPOCH + start, scene, poses, rng)


def truth_record(starts: dict[str, Pose], options: SimulationOptions) -> dict[str, Any]:
    """Describe the truth: T_world_map per robot, and T_target_source per pair of maps."""
    return {
        'plan': options.plan, 'seed': options.seed,
        'transforms': {name: pose_record(pose) for name, pose in starts.items()},
        'pairs': [{'target': a, 'source': b,
                   'transform': pose_record(Pose.from_array(between(starts[a], starts[b])))}
                  for a, b in combinations(starts, 2)],
    }


def _clear(folder: Path, names: list[str]) -> None:
    """Make room for new bags; only what an earlier simulation wrote is removed."""
    more = [f'robot{number}' for number in range(len(names) + 1, _robots_in(folder) + 1)]
    for name in (*names, *more):
        if not (folder / name).exists():
            continue
        if not (folder / TRUTH).exists():
            raise InputError(f'{folder / name}: exists and is not from an earlier simulation')
        shutil.rmtree(folder / name)


def _robots_in(folder: Path) -> int:
    """Return how many robots an earlier simulation had; 0 where its truth cannot be read."""
    try:
        return len(json.loads((folder / TRUTH).read_text())['transforms'])
    except (OSError, ValueError, KeyError, TypeError):
        return 0
