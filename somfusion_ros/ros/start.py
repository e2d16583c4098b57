# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The way into every process that needs ROS.

What a node needs takes seconds to import. A signal that comes meanwhile, as when a launch is
stopped at once, ends the process with status 0 and without a traceback.
"""

from importlib import import_module
import os
from pathlib import Path
import signal
import sys
from typing import Any

from somfusion_ros.io.errors import NO_ROS


def start(module: str) -> int:
    """
    Import a node's module, heed signals from the first moment on, and run its `main`.

    One line, and status 1, where ROS cannot be imported.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, leave)
    try:
        main: Any = import_module(module).main
    except ImportError as error:
        if (error.name or '').startswith('somfusion_ros'):
            raise
        sys.stderr.write(f'{Path(sys.argv[0]).stem}: {error}: {NO_ROS}\n')
        return 1
    return int(main())


def slam_node() -> int:
    """Run slam_node."""
    return help_for('slam_node') or start('somfusion_ros.ros.slam.node')


def fusion_node() -> int:
    """Run fusion_node."""
    return help_for('fusion_node') or start('somfusion_ros.ros.fusion.node')


def help_for(node: str) -> int:
    """Write how a node is used, and end, where that is asked for."""
    if not asks_for_help():
        return 0
    sys.stdout.write(import_module('somfusion_ros.ros.common.usage').usage(node))
    raise SystemExit(0)


def asks_for_help() -> bool:
    """Tell whether somebody wants to know how a program is used, which needs no ROS."""
    return bool({'-h', '--help'} & set(sys.argv[1:]))


def player() -> int:
    """Run the player of bags."""
    return app('player')


def watch() -> int:
    """Run `somfusion watch`."""
    return app('watch')


def app(name: str) -> int:
    """Run a program that is no node of a robot; tell how it is used where that is asked for."""
    if asks_for_help():
        import_module(f'somfusion_ros.ros.apps.{name}_options').parse(['--help'])
    return start(f'somfusion_ros.ros.apps.{name}')


def leave(*_: Any, status: int = 0) -> None:
    """End at once, with nothing that would have to be finished; also serves as signal handler."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(status)
