# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team of robots live on this machine: per robot a player, a slam_node and a fusion_node."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
import json
from pathlib import Path
import shutil
import time
from typing import Any

from somfusion_ros.io.bags.log import BagError, Log
from somfusion_ros.io.console import progress_bar
from somfusion_ros.ros.apps.processes import node_environment, Processes

START_TIMEOUT = 30.0   # [s] for all processes to find one another, before the bags are played
POLL = 0.25            # [s]
MAP_UPDATE_INTERVAL = 2.0   # [s] of wall time; shorter than the default, as the bags play fast
TRANSFORM_TIMEOUT = 5.0   # [s] a bag's odometry always comes, however busy the machine is
RECORDER, STATUS = 'recorder', 'status.json'


class LiveError(RuntimeError):
    """The live system did not do its job; one sentence that says where it stopped."""


@dataclass(frozen=True)
class LiveOptions:
    """rate: times real time; patience [s] after the bags end; settle [s] once all is joined."""

    rate: float = 2.0
    patience: float = 45.0
    settle: float = 6.0


def run_team(logs: Mapping[str, Log], folder: Path, options: LiveOptions) -> dict[str, Any]:
    """
    Play every robot's bag into its own two nodes until every robot knows the global map.

    Returns the recorder's last status, with `statuses` of all processes; the maps as published
    lie in folder/<robot>/{map,global_map}. LiveError, with a sentence, where that fails.
    """
    if (folder / STATUS).exists():   # of an earlier run: it must not be taken for this one's
        shutil.rmtree(folder)
    players = [f'player_{robot}' for robot in logs]
    with Processes(folder / 'logs', node_environment()) as processes:
        _start(processes, logs, folder, options.rate)
        longest = max(log.duration for log in logs.values()) / options.rate
        _wait_for_players(processes, players, longest)
        _wait_until_joined(processes, folder, list(logs), options)
        processes.stop([RECORDER])
        nodes = [name for name in _names(logs) if name not in players]
        ended = processes.stop(nodes)
    for name, status in ended.items():
        if status != 0:
            raise LiveError(f'{name} ended with status {status} when it was told to stop: '
                            f'{processes.last_words(name)}')
    return {**read_status(folder), 'statuses': processes.statuses}


def read_status(folder: Path) -> dict[str, Any]:
    """Return what the recorder wrote last; empty before it wrote anything."""
    try:
        return dict(json.loads((folder / STATUS).read_text()))
    except OSError:
        return {'robots': {}, 'diagnostics': {}}


def joined(status: Mapping[str, Any], robots: list[str]) -> bool:
    """Return whether every robot published the global map and is connected with all others."""
    for robot in robots:
        record = status['robots'].get(robot, {'maps': {}, 'transforms': {}})
        said = status['diagnostics'].get(f'{robot}/fusion_node', {}).get('values', {})
        peers = {name.rpartition('/')[0] for name in record['transforms']}
        peers |= set(said.get('connected', '').split(', '))   # also through other robots
        if 'global_map' not in record['maps'] or not set(robots) - {robot} <= peers:
            return False
    return True


def settled(status: Mapping[str, Any]) -> bool:
    """Return whether every fusion node has matched the maps as they are now."""
    return all(record['values'].get('settled', 'True') == 'True'
               for record in status['diagnostics'].values())


def why_not(status: Mapping[str, Any], robots: list[str]) -> str:
    """Describe what is missing, robot by robot, in the words of the nodes."""
    missing = []
    for robot in robots:
        maps = status['robots'].get(robot, {}).get('maps', {})
        if 'map' not in maps:
            missing.append(f'{robot} published no map')
        elif not joined(status, [robot]):
            missing.append(f'{robot} published no global map')
    words = [f'{name}: {record["values"].get("reason") or record["message"]}'
             for name, record in status['diagnostics'].items()
             if record['message'] != 'ok' and 'fusion_node' in name]
    return '; '.join([*(missing or ['not every robot was joined with every other']), *words])


def _names(logs: Mapping[str, Log]) -> list[str]:
    """Return the names of all processes but the recorder."""
    return [f'{kind}_{robot}' for robot in logs for kind in ('slam', 'fusion', 'player')]


def _start(processes: Processes, logs: Mapping[str, Log], folder: Path, rate: float) -> None:
    """Start the nodes of every robot, the recorder, and then the players."""
    processes.start(RECORDER, 'somfusion_ros.ros.apps.recorder', [str(folder), *logs])
    for robot, log in logs.items():
        common = ['--ros-args', '-r', f'__ns:=/{robot}', '-r', '/tf:=tf',
                  '-r', '/tf_static:=tf_static']
        processes.start(f'slam_{robot}', 'somfusion_ros.ros.slam_node',
                        [*common, *_slam_parameters(log)])
        processes.start(f'fusion_{robot}', 'somfusion_ros.ros.fusion_node', common)
    for robot, log in logs.items():
        processes.start(f'player_{robot}', 'somfusion_ros.ros.apps.player',
                        [str(log.path), '--rate', str(rate), '--wait', str(START_TIMEOUT),
                         *_topics(log), '--ros-args', '-r', f'__ns:=/{robot}'])


def _topics(log: Log) -> list[str]:
    """Return what the player is to play of a bag: the first laser, whose mount slam_node gets."""
    odometry = ['--odom-topic', log.odometry.topic] if log.odometry.kind == 'odom' else []
    return ['--scan-topic', next(iter(log.lasers)), *odometry]


def _slam_parameters(log: Log) -> list[str]:
    """Return parameters of slam_node found in the bag: frames, laser mount, odometry."""
    if log.odometry.kind == 'tf' and not find_spec('tf2_msgs'):
        raise BagError(f'{log.path}: its odometry is only in /tf, which needs tf2_msgs here')
    x, y, theta = (float(value) for value in log.T_base_laser)
    values = {'base_frame': log.odometry.base_frame,
              'odometry_source': log.odometry.kind,
              **({'odom_frame': log.odometry.frames[0]} if log.odometry.frames else {}),
              'map_update_interval': MAP_UPDATE_INTERVAL,
              'transform_timeout': TRANSFORM_TIMEOUT}
    if not (log.upside_down and find_spec('tf2_msgs')):   # which laser_pose cannot say, but TF
        values['laser_pose'] = f'[{x!r}, {y!r}, {theta!r}]'
    return [part for name, value in values.items() for part in ('-p', f'{name}:={value}')]


def _wait_for_players(processes: Processes, players: list[str], longest: float) -> None:
    """Wait until the bags have been played; LiveError if anything ends early or nothing ends."""
    started = time.monotonic()
    with progress_bar('playing', round(longest), 's') as bar:
        while not set(players) <= _check(processes, players).keys():
            passed = time.monotonic() - started
            if passed > longest + 2.0 * START_TIMEOUT:
                raise LiveError(f'the bags were not played within {passed:.0f} s')
            bar.update(min(round(passed), round(longest)) - bar.n)
            time.sleep(POLL)


def _wait_until_joined(processes: Processes, folder: Path, robots: list[str],
                       options: LiveOptions) -> None:
    """Wait until all robots are joined and the last scans are in the maps."""
    until = time.monotonic() + options.patience
    while not joined(read_status(folder), robots):
        if time.monotonic() > until:
            raise LiveError(f'no global map on every robot {options.patience:.0f} s after the '
                            f'bags ended: {why_not(read_status(folder), robots)}')
        _check(processes, [n for n in processes.ended() if n.startswith('player_')])
        time.sleep(POLL)
    time.sleep(options.settle)
    until = time.monotonic() + options.patience
    while not settled(read_status(folder)) and time.monotonic() < until:
        time.sleep(POLL)


def _check(processes: Processes, may_end: list[str]) -> dict[str, int]:
    """Return who has ended; LiveError if one ended that should not, or with an error."""
    ended = processes.ended()
    for name, status in ended.items():
        if status != 0 or name not in may_end:
            raise LiveError(f'{name} ended early with status {status}: '
                            f'{processes.last_words(name)} (log: {processes.log_path(name)})')
    return ended
