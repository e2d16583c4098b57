# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, and how their values are read."""

import argparse

from typing import TypeAlias

from somfusion_ros.geometry import Pose

# What `add_subparsers` returns; argparse has no public name for it.
Commands: TypeAlias = 'argparse._SubParsersAction[argparse.ArgumentParser]'


def add_output(command: argparse.ArgumentParser) -> None:
    """Add the output folder."""
    command.add_argument('--output', required=True, metavar='DIR', help='folder for the results')


def add_fusion(command: argparse.ArgumentParser) -> None:
    """Add what replay and merge share."""
    command.add_argument('--parameters', action='append', default=[], metavar='YAML',
                         help='parameter file of the nodes, such as config/slam.yaml: method and '
                              'confidence of the merge; for replay also the SLAM, the mount of '
                              'the laser and the source of the odometry; may be given again')
    command.add_argument('--method', choices=['som', 'paper'],
                         help='som: many hypotheses and a verdict; paper: the literal IROS 2011 '
                              'method (default som)')
    command.add_argument('--no-report', action='store_true', help='draw no pictures')


def given(**values: object) -> dict[str, object]:
    """Keep the options that were given."""
    return {name: value for name, value in values.items() if value is not None}


def pose(text: str) -> Pose:
    """Parse X,Y,THETA."""
    try:
        return Pose.from_array([float(part) for part in text.split(',')])
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not X,Y,THETA') from None


def positive(text: str) -> float:
    """Parse a number over 0."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number') from None
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'{text} must be over 0')
    return value


def count(text: str) -> int:
    """Parse a whole number over 0."""
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number over 0')
    return int(text)
