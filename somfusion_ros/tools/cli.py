# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command `somfusion`: replay, merge, simulate, report, watch."""

import argparse
from collections.abc import Sequence
import importlib.util
import os
import sys

from somfusion_ros import __version__
from somfusion_ros.geometry import Pose
from somfusion_ros.tools.console import complain

BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0 when it ran, 2 on bad usage or input."""
    described = parser()
    options, more = described.parse_known_args(arguments)
    if more and options.command != 'watch':
        described.error(f'unrecognized arguments: {" ".join(more)}')
    options.more = more
    try:
        options.run(options)
    except (ValueError, OSError) as error:
        complain(f'somfusion {options.command}: {error}')
        return BAD_INPUT
    except KeyboardInterrupt:
        complain(f'somfusion {options.command}: interrupted')
        return 130
    return 0


def parser() -> argparse.ArgumentParser:
    """Describe the commands and their options."""
    top = argparse.ArgumentParser(
        prog='somfusion',
        description='Multi-robot 2-D SLAM: maps from logs, one map from several robots.')
    top.add_argument('--version', action='version', version=f'%(prog)s {__version__}')
    commands = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    _add_replay(commands)
    _add_merge(commands)
    _add_simulate(commands)
    _add_report(commands)
    _add_watch(commands)
    return top


def _add_replay(commands: argparse._SubParsersAction) -> None:
    """Describe `replay`."""
    command = commands.add_parser(
        'replay', help='logs of one or more robots -> maps, trajectories, global map',
        description='Run the SLAM over one bag per robot, then merge the maps. Topics, laser '
                    'mount and odometry are found in each bag unless they are named here.')
    command.add_argument('bags', nargs='+', metavar='BAG',
                         help='rosbag1, or rosbag2 in sqlite3 or mcap; one robot per bag')
    _add_output(command)
    command.add_argument('--scan-topic', help='topic of the laser scans')
    command.add_argument('--odom-topic', help='topic of nav_msgs/Odometry')
    command.add_argument('--odometry-source', default='auto',
                         choices=['auto', 'odom', 'encoders', 'tf'],
                         help='odom: nav_msgs/Odometry; encoders: two wheels in joint states; '
                              'tf: odom -> base in /tf; auto: the first of these in the bag')
    command.add_argument('--laser-pose', type=_pose, metavar='X,Y,THETA',
                         help='laser in the base frame [m, m, rad], instead of tf_static; '
                              'write --laser-pose=-0.1,0,0 where X is negative')
    command.add_argument('--wheel-radius', type=_positive, metavar='M', help='for encoders [m]')
    command.add_argument('--wheel-separation', type=_positive, metavar='M',
                         help='for encoders [m]')
    command.add_argument('--resolution', type=_positive, metavar='M',
                         help='edge of a map cell [m] (default 0.05)')
    command.add_argument('--jobs', type=_count, metavar='N',
                         help='robots at work at once (default: one per core)')
    command.add_argument('--bag', action='store_true',
                         help='also write DIR/bag (mcap): maps, poses, tf, clusters and the '
                              'global map over time, for Foxglove and RViz')
    _add_fusion(command)
    command.set_defaults(run=_replay)


def _add_merge(commands: argparse._SubParsersAction) -> None:
    """Describe `merge`."""
    command = commands.add_parser(
        'merge', help='saved maps -> one stitched map',
        description='Find how saved maps lie to one another and stitch them.')
    command.add_argument('maps', nargs='+', metavar='MAP.yaml',
                         help='map_server YAML files, at least two')
    _add_output(command)
    _add_fusion(command)
    command.set_defaults(run=_merge)


def _add_simulate(commands: argparse._SubParsersAction) -> None:
    """Describe `simulate`."""
    from somfusion_ros.tools.floor_plan import PLANS
    command = commands.add_parser(
        'simulate', help='bags of simulated robots with ground truth',
        description='Drive robots with a 240 degree laser and two wheel encoders through a '
                    'floor plan, and record a bag and the true trajectory of each.')
    command.add_argument('--robots', type=_count, default=2, metavar='N', help='(default 2)')
    _add_output(command)
    command.add_argument('--seed', type=int, default=0, help='of the noise (default 0)')
    command.add_argument('--plan', choices=sorted(PLANS), default='office',
                         help='floor plan (default office, 17 x 10 m)')
    command.add_argument('--duration', type=_positive, metavar='S',
                         help='longest run of a robot [s] (default: 75 to 140, as the plan needs)')
    command.add_argument('--wheel-error', type=float, default=0.03, metavar='SHARE',
                         help='largest error of wheel radius and separation (default 0.03)')
    command.add_argument('--storage', choices=['mcap', 'sqlite3'], default='mcap',
                         help='of the bags (default mcap)')
    command.set_defaults(run=_simulate)


def _add_report(commands: argparse._SubParsersAction) -> None:
    """Describe `report`."""
    command = commands.add_parser(
        'report', help='draw the figures of a result again',
        description='Draw the figures of a folder that replay or merge wrote: DIR/report.png '
                    'and DIR/figures/.')
    command.add_argument('folder', metavar='DIR')
    command.set_defaults(run=_report)


def _add_watch(commands: argparse._SubParsersAction) -> None:
    """Describe `watch`; its options are its own program's."""
    command = commands.add_parser(
        'watch', help='live maps of a team in the terminal', add_help=False)
    command.set_defaults(run=_watch)


def _add_output(command: argparse.ArgumentParser) -> None:
    """Add the output folder."""
    command.add_argument('--output', required=True, metavar='DIR', help='folder for the results')


def _add_fusion(command: argparse.ArgumentParser) -> None:
    """Add what replay and merge share."""
    command.add_argument('--parameters', action='append', default=[], metavar='YAML',
                         help='parameter file of the nodes, such as config/slam.yaml; may be '
                              'given again')
    command.add_argument('--method', choices=['som', 'paper'],
                         help='som: many hypotheses and a verdict; paper: the literal IROS 2011 '
                              'method (default som)')
    command.add_argument('--seed', type=int, default=0, help='of the merge (default 0)')
    command.add_argument('--no-report', action='store_true', help='draw no pictures')


def _replay(options: argparse.Namespace) -> None:
    """Run `replay`."""
    from somfusion_ros.config import FusionConfig, SlamConfig
    from somfusion_ros.tools.bags import BagOptions
    from somfusion_ros.tools.parameter_file import make, read_parameters
    from somfusion_ros.tools.replay import replay, ReplayOptions
    values = read_parameters(options.parameters)
    bags = BagOptions(options.scan_topic, options.odom_topic, options.odometry_source,
                      options.laser_pose, options.wheel_radius, options.wheel_separation)
    replay(options.bags, options.output, ReplayOptions(
        bags, make(SlamConfig, values, **_given(resolution=options.resolution)),
        make(FusionConfig, values, **_given(method=options.method)),
        options.seed, options.jobs, not options.no_report, options.bag))


def _merge(options: argparse.Namespace) -> None:
    """Run `merge`."""
    from somfusion_ros.config import FusionConfig
    from somfusion_ros.tools.merge import merge
    from somfusion_ros.tools.parameter_file import make, read_parameters
    values = read_parameters(options.parameters)
    config = make(FusionConfig, values, **_given(method=options.method))
    merge(options.maps, options.output, config, options.seed, not options.no_report)


def _given(**values: object) -> dict[str, object]:
    """Keep the options that were given."""
    return {name: value for name, value in values.items() if value is not None}


def _simulate(options: argparse.Namespace) -> None:
    """Run `simulate`."""
    from somfusion_ros.tools.simulate import simulate, SimulationOptions
    simulate(options.output, SimulationOptions(
        options.robots, options.plan, options.seed, options.duration, options.wheel_error,
        options.storage))


def _report(options: argparse.Namespace) -> None:
    """Run `report`."""
    from somfusion_ros.tools.report import report
    report(options.folder)


def _watch(options: argparse.Namespace) -> None:
    """Become `watch`, which needs ROS as nothing else here does."""
    if importlib.util.find_spec('rclpy') is None:
        raise ValueError('rclpy is missing: source ROS 2 Jazzy, or pip install somfusion_ros[ros]')
    os.execv(sys.executable, [sys.executable, '-m', 'somfusion_ros.ros.watch',
                              *options.more])


def _pose(text: str) -> Pose:
    """Parse X,Y,THETA."""
    try:
        return Pose.from_array([float(part) for part in text.split(',')])
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not X,Y,THETA') from None


def _positive(text: str) -> float:
    """Parse a number over 0."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number') from None
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'{text} must be over 0')
    return value


def _count(text: str) -> int:
    """Parse a whole number over 0."""
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number over 0')
    return int(text)


if __name__ == '__main__':
    sys.exit(main())
