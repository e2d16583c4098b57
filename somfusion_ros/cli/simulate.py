# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion simulate`: bags of simulated robots with ground truth."""

import argparse

from somfusion_ros.cli.options import add_output, Commands, count, positive


def add(commands: Commands) -> None:
    """Describe `simulate`."""
    from somfusion_ros.simulation.floor_plan import PLANS
    command = commands.add_parser(
        'simulate', help='bags of simulated robots with ground truth',
        description='Drive robots with a 240 degree laser and two wheel encoders through a '
                    'floor plan, and record a bag and the true trajectory of each.')
    command.add_argument('--robots', type=count, default=2, metavar='N', help='(default 2)')
    add_output(command)
    command.add_argument('--seed', type=int, default=0, help='of the noise (default 0)')
    command.add_argument('--plan', choices=sorted(PLANS), default='office',
                         help='floor plan (default office, 17 x 10 m)')
    command.add_argument('--duration', type=positive, metavar='S',
                         help='longest run of a robot [s] (default: 75 to 140, as the plan needs)')
    command.add_argument('--wheel-error', type=float, default=0.03, metavar='SHARE',
                         help='largest error of wheel radius and separation (default 0.03)')
    command.add_argument('--storage', choices=['mcap', 'sqlite3'], default='mcap',
                         help='of the bags (default mcap)')
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run `simulate`."""
    from somfusion_ros.simulation.simulate import simulate, SimulationOptions
    simulate(options.output, SimulationOptions(
        options.robots, options.plan, options.seed, options.duration, options.wheel_error,
        options.storage))
