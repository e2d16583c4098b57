# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion watch`: live maps of a team in the terminal."""

import argparse
import os
import sys

from somfusion_ros.cli.options import Commands


def add(commands: Commands) -> None:
    """Describe `watch`; its options are its own program's."""
    command = commands.add_parser(
        'watch', help='live maps of a team in the terminal', add_help=False)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Become `watch`, which needs ROS as nothing else here does."""
    os.execv(sys.executable, [sys.executable, '-m', 'somfusion_ros.ros.watch', *options.more])
