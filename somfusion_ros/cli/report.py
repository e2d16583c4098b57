# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion report`: draw the figures of a result again."""

import argparse

from somfusion_ros.cli.options import Commands


def add(commands: Commands) -> None:
    """Describe `report`."""
    command = commands.add_parser(
        'report', help='draw the figures of a result again',
        description='Draw the figures of a folder that replay or merge wrote: DIR/report.png '
                    'and DIR/figures/.')
    command.add_argument('folder', metavar='DIR')
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run `report`."""
    from somfusion_ros.report.report import report
    report(options.folder)
