# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The whole system at work, live: `python -m somfusion_ros.ros.apps.demo [BAG BAG ...]`.

Without bags it simulates two robots in a floor plan and holds the result against the truth. The
bags are played, faster than they were recorded, into two nodes per robot, each a process of its
own; at the end every robot's transforms and global map are shown.
"""

import argparse
from collections.abc import Mapping, Sequence
import importlib.util
import json
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags.log import Log, open_log
from somfusion_ros.io.console import complain, say
from somfusion_ros.io.errors import NO_ROS
from somfusion_ros.io.result import make_folder, pose_of
from somfusion_ros.ros.apps.demo_picture import draw_live
from somfusion_ros.ros.apps.demo_table import compare, robot_lines, table, TOLERANCE
from somfusion_ros.ros.apps.demo_team import LiveError, LiveOptions, run_team
from somfusion_ros.simulation.simulate import simulate, SimulationOptions, TRUTH
from somfusion_ros.whole_files import write_text

DURATION = 75.0   # [s] of the simulated drives


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration; return 0 if it succeeded, 1 if not, 2 on bad usage or input."""
    options = parser().parse_args(arguments)
    for number in (signal.SIGINT, signal.SIGTERM):   # leave every block in order
        signal.signal(number, signal.default_int_handler)
    try:
        demonstrate(options)
    except LiveError as error:
        complain(f'demo: {error}')
        return 1
    except (ValueError, OSError) as error:
        complain(f'demo: {error}')
        return 2
    except KeyboardInterrupt:
        complain('demo: interrupted')
        return 130
    return 0


def parser() -> argparse.ArgumentParser:
    """Describe the options."""
    top = argparse.ArgumentParser(prog='demo', description=__doc__.partition('\n\n')[0])
    top.add_argument('bags', nargs='*', metavar='BAG', help='one per robot; none: simulated')
    top.add_argument('--output', default='output/demo', metavar='DIR')
    top.add_argument('--rate', type=float, default=2.0, help='times real time (default 2)')
    top.add_argument('--seed', type=int, default=0, help='of the simulation (default 0)')
    top.add_argument('--compare', action='store_true',
                     help='hold the result against `somfusion replay` of the same bags')
    return top


def demonstrate(options: argparse.Namespace) -> None:
    """Simulate or take the bags, run the team, show the outcome; LiveError where it fails."""
    _check_options(options)
    started = time.monotonic()
    folder = make_folder(options.output)
    bags, truth = options.bags, None
    if not bags:
        bags, truth = _simulated(folder / 'simulation', options.seed)
    logs = {f'robot{n}': open_log(bag) for n, bag in enumerate(bags, start=1)}
    for robot, log in logs.items():
        if len(log.lasers) > 1:
            say(f'{robot}: of its lasers, {log.scan_topic}, only the first is played')
    reference = _replayed(folder / 'replay', bags) if options.compare else truth
    prepared = time.monotonic()
    say(f'playing {len(logs)} bags at {options.rate:g} times real time into '
        f'{2 * len(logs)} nodes ...')
    status = run_team(logs, folder / 'live', LiveOptions(rate=options.rate))
    seconds = {'preparation': prepared - started, 'live': time.monotonic() - prepared}
    show(folder, logs, status, reference, seconds, 'replay' if options.compare else 'truth')


def show(folder: Path, logs: Mapping[str, Log], status: Mapping[str, Any],
         reference: Mapping[tuple[str, str], Pose] | None, seconds: Mapping[str, float],
         reference_name: str) -> None:
    """Print and draw the outcome, write it to live.json; LiveError if it is clearly wrong."""
    rows = compare(status, reference)
    say()
    for line in table(rows, reference_name):
        say(line)
    say()
    for line in robot_lines(status, logs):
        say(line)
    say(', '.join(f'{name} {value:.1f} s' for name, value in seconds.items()))
    write_text(folder / 'live.json', json.dumps(
        {'pairs': [row.record() for row in rows], 'seconds': dict(seconds),
         'diagnostics': status['diagnostics']}, indent=2) + '\n')
    say(f'picture: {draw_live(folder, list(logs), rows)}')
    wrong = [(row, row.error) for row in rows
             if row.error is not None and not row.within(TOLERANCE)]
    if wrong:
        raise LiveError('; '.join(
            f'{row.target} -> {row.source} is {metres:.2f} m and {degrees:.1f} deg off the '
            f'{reference_name}' for row, (metres, degrees) in wrong))


def _check_options(options: argparse.Namespace) -> None:
    """Raise ValueError, with a sentence, where the demonstration cannot start."""
    if len(options.bags) == 1:
        raise ValueError('a team needs at least two bags, one per robot')
    if not 0.0 < options.rate <= 100.0:
        raise ValueError(f'rate {options.rate} is outside (0, 100]')
    if importlib.util.find_spec('rclpy') is None:
        raise ValueError(f'rclpy is missing: {NO_ROS}')
    os.environ.setdefault('MPLBACKEND', 'Agg')


def _simulated(folder: Path, seed: int) -> tuple[list[Path], dict[tuple[str, str], Pose]]:
    """Simulate two robots; return their bags and the true relative transforms."""
    say('simulating two robots ...')
    simulate(folder, SimulationOptions(seed=seed, duration=DURATION))
    pairs = json.loads((folder / TRUTH).read_text())['pairs']
    return [folder / f'robot{n}' / 'bag' for n in (1, 2)], _poses(pairs)


def _replayed(folder: Path, bags: Sequence[str | Path]) -> dict[tuple[str, str], Pose]:
    """Replay the bags offline; return the relative transforms found there."""
    from somfusion_ros.offline.replay import replay, ReplayOptions
    say('replaying offline, to compare with ...')
    return _poses(p for p in replay(bags, folder, ReplayOptions())['pairs'] if p['accepted'])


def _poses(pairs: Any) -> dict[tuple[str, str], Pose]:
    """Return T_target_source of pairs as they stand in a JSON file."""
    found = {(p['target'], p['source']): pose_of(p['transform']) for p in pairs}
    return {pair: pose for pair, pose in found.items() if pose is not None}


if __name__ == '__main__':
    sys.exit(main())
