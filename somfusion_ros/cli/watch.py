# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion watch`: live maps of a team in the terminal."""

import argparse
import importlib.util
import os
import sys

from somfusion_ros.cli.options import Commands
from somfusion_ros.io.errors import NO_ROS


def add(commands: Commands) -> None:
    """Describe `watch`; its options are its own program's."""
    command = commands.add_parser(
        'watch', help='live maps of a team in the terminal', add_help=False)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Become `watch`, which needs ROS as nothing else here does."""
    if importlib.util.find_spec('rclpy') is None:
        raise ValueError(f'rclpy is missing: {NO_ROS}')
    os.execv(sys.executable, [sys.executable, '-m', 'somfusion_ros.ros.apps.watch',
                              *options.more])
