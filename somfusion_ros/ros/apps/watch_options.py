# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `somfusion watch` can be told; no ROS is needed to say it."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from somfusion_ros.ros.common import names


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the arguments; on bad usage or `--help` the program ends."""
    parser = argparse.ArgumentParser(
        prog='somfusion watch', description="Show a team's maps in the terminal as they merge.")
    parser.add_argument('--once', action='store_true', help='show the team once and end')
    parser.add_argument('--wait', type=float, default=5.0, metavar='S',
                        help='with --once: how long to listen [s] (default 5)')
    parser.add_argument('--map-topic', default=names.MAP, metavar='NAME',
                        help="last name of the robots' map topics (default map)")
    parser.add_argument('--svg', metavar='FILE', help='also keep the last picture as SVG')
    options = parser.parse_args(arguments)
    if not 0.0 <= options.wait < float('inf'):
        parser.error(f'--wait {options.wait} is no time in seconds')
    if options.svg and not Path(options.svg).parent.is_dir():
        parser.error(f'--svg {options.svg}: there is no such folder')
    return options
