# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command `somfusion`: replay, merge, simulate, report, watch."""

import argparse
from collections.abc import Sequence
import sys

from somfusion_ros import __version__
from somfusion_ros.cli import merge, replay, report, simulate, watch
from somfusion_ros.io.console import complain

BAD_INPUT = 2
COMMANDS = (replay, merge, simulate, report, watch)


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
    for command in COMMANDS:
        command.add(commands)
    return top


if __name__ == '__main__':
    sys.exit(main())
