# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command `somfusion`: replay, merge, simulate, report, watch."""

import argparse
from collections.abc import Sequence
import signal
import sys

from somfusion_ros import __version__

BAD_INPUT, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0 when it ran, 2 on bad usage or input, 130 when it was stopped."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return run(arguments)
    except KeyboardInterrupt:   # SIGINT or SIGTERM, also while numpy is still being imported
        sys.stderr.write('somfusion: interrupted\n')
        return INTERRUPTED
    finally:
        signal.signal(signal.SIGTERM, before)


def run(arguments: Sequence[str] | None) -> int:
    """Run a command to its end; return 0 when it ran, 2 on bad usage or input."""
    from somfusion_ros.io.console import complain
    from somfusion_ros.io.errors import sentence
    described = parser()
    options, more = described.parse_known_args(arguments)
    if more and options.command != 'watch':
        described.error(f'unrecognized arguments: {" ".join(more)}')
    options.more = more
    try:
        options.run(options)
    except (ValueError, OSError) as error:
        complain(f'somfusion {options.command}: {sentence(error)}')
        return BAD_INPUT
    return 0


def parser() -> argparse.ArgumentParser:
    """Describe the commands and their options."""
    from somfusion_ros.cli import merge, replay, report, simulate, watch
    top = argparse.ArgumentParser(
        prog='somfusion',
        description='Multi-robot 2-D SLAM: maps from logs, one map from several robots.')
    top.add_argument('--version', action='version', version=f'%(prog)s {__version__}')
    commands = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in (replay, merge, simulate, report, watch):
        command.add(commands)
    return top


if __name__ == '__main__':
    sys.exit(main())
