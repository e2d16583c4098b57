# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion replay`: bags in; per robot a map and a trajectory, for a team the global map."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
import time
from typing import Any

import numpy as np
from somfusion_ros import __version__
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Array
from somfusion_ros.io.bags.log import BagOptions, Log, open_log, robots_in
from somfusion_ros.io.console import complain, say
from somfusion_ros.io.errors import InputError, reason_of
from somfusion_ros.io.maps import refuse_to_overwrite, write_map
from somfusion_ros.io.result import fusion_record, make_folder, write_result, write_robot_map
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.offline.beginning import Beginning, from_map, from_state
from somfusion_ros.offline.fusing import draw, fuse_with_progress
from somfusion_ros.offline.result_bag import period_of, refuse_to_replace, write_replay_bag
from somfusion_ros.offline.robot_run import RobotRun
from somfusion_ros.offline.robot_runs import run_robots
from somfusion_ros.offline.summary import tell_found, tell_fusion, tell_robot
from somfusion_ros.slam.checkpoint_file import save_checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.joint_map import along, draw_joint
from somfusion_ros.team.offline import Fusion
from somfusion_ros.team.view_facts import heard
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.view_store import told_bytes

JOINT_FILES = ('joint.tum', 'joint_map.yaml', 'joint_map.pgm')
STRIDE = 0.2   # [m] of way that counts at once


@dataclass(frozen=True)
class ReplayOptions:
    """
    How to replay: what to use of the bags, parameters, processes, pictures, a bag.

    namespaces: of the robots in each bag; empty: all that are found. state: a file to go on from
    where there is one, and to write at the end; localize: a map to be found and tracked in.
    """

    bags: BagOptions = field(default_factory=BagOptions)
    slam: SlamConfig = field(default_factory=SlamConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)
    jobs: int | None = None
    pictures: bool = True
    bag: bool = False
    namespaces: tuple[str, ...] = ()
    state: Path | None = None
    localize: Path | None = None


def replay(bags: Sequence[str | Path], output: str | Path,
           options: ReplayOptions | None = None) -> dict[str, Any]:
    """
    Replay bags of one robot or of several, and write everything into a folder.

    Parameters
    ----------
    bags : sequence of path
        One per robot, or bags with several robots in namespaces; the robots are named robot1,
        robot2, ... in this order.
    output : path
        Folder for maps, trajectories, result.json and the report; made where it is missing.
    options : ReplayOptions, optional
        What to use of the bags, and parameters.

    Returns
    -------
    dict
        What is in result.json: `robots`, `pairs`, `transforms` [m, rad] and more.

    Raises
    ------
    InputError
        In one line, where a bag or the folder cannot be used.

    Examples
    --------
    >>> from somfusion_ros.simulation.simulate import simulate, SimulationOptions
    >>> truth = simulate('bags', SimulationOptions(robots=1, duration=4.0))
    robot1: ...
    >>> record = replay(['bags/robot1'], 'out')
    robot1: ...
    >>> record['robots']['robot1']['scans'] > 20
    True
    """
    options, started = options or ReplayOptions(), time.perf_counter()
    logs = {f'robot{number}': log
            for number, log in enumerate(open_logs(bags, options), start=1)}
    beginning = _beginning(options, len(logs))
    if options.localize is not None:
        refuse_to_overwrite([options.localize], [Path(output), Path(output) / 'robot1'])
    if options.bag:
        refuse_to_replace(Path(output) / 'bag', [log.path for log in logs.values()])
    folder = make_folder(output)
    period = period_of([log.duration for log in logs.values()]) if options.bag else None
    runs = run_robots(logs, options.slam, options.jobs, period, beginning)
    record = save_team(folder, runs, options, started, beginning)
    if options.state is not None:
        _save_state(options.state, runs['robot1'])
    return record


def save_team(folder: Path, runs: Mapping[str, RobotRun], options: ReplayOptions,
              started: float, beginning: Beginning | None = None) -> dict[str, Any]:
    """Merge the robots' maps, and write and tell everything; `started`: a clock's time [s]."""
    robots = {name: save_robot(folder / name, run) for name, run in runs.items()}
    found = found_record(runs['robot1'], beginning) if beginning else {}
    robots = {name: {**record, **found} for name, record in robots.items()}
    for name, record in robots.items():
        tell_robot(name, record)
        for note in record['notes']:
            complain(f'{name}: {note}')
    fusion = fuse_with_progress({name: run.grid for name, run in runs.items()}, options.fusion,
                                options.pictures, _views(runs))
    write_map(folder, fusion.global_map)
    save_joint(folder, runs, fusion)
    record = {'command': 'replay', 'version': __version__, 'fusion_config': asdict(options.fusion),
              'robots': robots, **fusion_record(fusion), **found, 'map': 'map.yaml',
              'seconds': time.perf_counter() - started}
    write_result(folder, record)
    tell_fusion(record, str(folder / 'map.yaml'))
    if beginning and beginning.checkpoint:
        tell_found(record)
    if options.pictures and len(runs) > 1:
        draw(folder, fusion)
    if options.bag:
        say(f'bag: {write_replay_bag(folder / "bag", runs, options.fusion, fusion)}')
    return record


def _views(runs: Mapping[str, RobotRun]) -> dict[str, ViewSet]:
    """Put every robot's views together as its peers hear of them; {} for a robot alone."""
    views: dict[str, ViewSet] = {}
    for name, run in runs.items() if len(runs) > 1 else ():
        try:
            views[name] = heard(run.facts)
        except ValueError as error:
            complain(f'{name}: its views cannot be used, its map is not bent: {error}')
    return views


def save_joint(folder: Path, runs: Mapping[str, RobotRun], fusion: Fusion) -> None:
    """
    Write every robot's path and map at the joint solution, where there is one.

    Where there is none, those of an earlier run in the same folder are deleted.
    """
    joint = fusion.elastic.poses if fusion.elastic else {}
    for name in runs.keys() - joint.keys():
        for file in JOINT_FILES:
            (folder / name / file).unlink(missing_ok=True)
    for name, poses in joint.items():
        run, views = runs[name], fusion.views[name]
        write_tum(folder / name / 'joint.tum', run.stamps,
                  along(run.stamps, run.poses, run.held, views.poses, poses))
        write_map(folder / name, draw_joint(fusion.views, joint,
                                            run.grid.resolution, (name,)), 'joint_map')


def open_logs(bags: Sequence[str | Path], options: ReplayOptions) -> list[Log]:
    """Open the log of every robot: one per bag, or all that a bag holds."""
    logs = []
    for bag in bags:
        names = options.namespaces or robots_in(bag)
        if len(names) > 1 and not options.namespaces:
            say(f'{bag}: robots {", ".join(names)}')
        logs += [open_log(bag, replace(options.bags, namespace=name.strip('/')))
                 for name in names]
    if len({(log.path.resolve(), log.options.namespace) for log in logs}) < len(logs):
        raise InputError(f'{" ".join(map(str, bags))}: a bag is given twice; it is one robot')
    return logs


def _beginning(options: ReplayOptions, bags: int) -> Beginning | None:
    """Return the map that the replay goes on in, None where each robot begins a new one."""
    if options.state is None and options.localize is None:
        return None
    if bags > 1:
        raise InputError('a state, or a map to localise in, is for one robot: give one bag')
    if options.localize is not None:
        return from_map(options.localize)
    return None if options.state is None else from_state(options.state)


def _save_state(path: Path, run: RobotRun) -> None:
    """Write the state of a run; InputError where the disk does not take it."""
    if run.checkpoint is None:
        return
    try:
        save_checkpoint(path, run.checkpoint)
    except OSError as error:
        raise InputError(f'{path}: {reason_of(error)}') from error


def found_record(run: RobotRun, beginning: Beginning) -> dict[str, Any]:
    """Return when and where a robot was found in the map that it started in, for result.json."""
    found = run.found
    if beginning.checkpoint is None or found is None:
        return {'found_after_m': None, 'found_at': None, 'found_transform': None}
    x, y, theta = (float(value) for value in found.T_map_piece)
    return {'found_after_m': found.metres, 'found_at': found.stamp,
            'found_transform': {'x': x, 'y': y, 'theta': theta}}


def driven(poses: Array) -> float:
    """Return the way [m] along poses (n, 3), in steps of STRIDE, so that standing adds nothing."""
    way, last = 0.0, poses[0]
    for pose in poses[1:]:
        step = float(np.hypot(*(pose - last)[:2]))
        if step >= STRIDE:
            way, last = way + step, pose
    return way


def save_robot(folder: Path, run: RobotRun) -> dict[str, Any]:
    """Write one robot's map and trajectories; return its part of result.json."""
    folder.mkdir(parents=True, exist_ok=True)
    write_robot_map(folder, run.grid)
    write_tum(folder / 'trajectory.tum', run.stamps, run.poses)
    write_tum(folder / 'views.tum', run.view_stamps, run.views)
    ms = run.milliseconds
    return {
        'bag': str(run.log.path),
        'scan_topic': run.log.scan_topic,
        'odometry_topic': run.log.odometry_topic,
        'odometry_source': run.log.odometry_source,
        'laser_pose': list(run.log.T_base_laser),
        'namespace': run.log.options.namespace,
        'scans': len(ms),
        'views': len(run.views),
        'view_bytes': told_bytes(run.facts),
        'distance': driven(run.poses),
        'recorded_seconds': run.recorded,
        'seconds': run.seconds,
        'real_time_factor': run.recorded / max(run.seconds, 1e-9),
        'milliseconds_per_scan': {
            'median': float(np.median(ms)) if len(ms) else 0.0,
            'p99': float(np.percentile(ms, 99)) if len(ms) else 0.0},
        'notes': [*run.log.notes, *run.notes],
        'counters': {name: int(count) for name, count in run.counters.items()},
    }
