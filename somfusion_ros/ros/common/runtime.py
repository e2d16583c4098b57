# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The life of a node's process: start, spin, stop.

Callbacks run in one spinning thread; the main thread waits for SIGINT or SIGTERM and then stops
everything in the one order that rclpy takes without complaint: executor, thread, workers, node,
context. Both signals end a process with status 0, also in the middle of work: at once while the
node is being made, as nothing is to be saved yet, and after LONGEST whatever is still going on.
"""

from collections.abc import Callable
import logging
import signal
import sys
import threading
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from somfusion_ros.io.errors import InputError, reason_of
from somfusion_ros.ros.start import leave

STOP_TIMEOUT = 2.0   # [s] that a callback or a worker is given to finish its piece of work
LONGEST = 4.0        # [s] from a signal to the end; a checkpoint may be cut off, not damaged
SWITCH_INTERVAL = 0.001   # [s] a worker thread holds the interpreter while a scan waits


def run(make_node: Callable[[threading.Event], Any], args: list[str] | None = None) -> int:
    """
    Make a node, spin it until a signal or until it sets the stop event, and return a status.

    Of a node more is needed than rclpy has: close(timeout) stops its workers and returns whether
    all of them ended in time; begin(arguments), if there is one, is called once it is made, and
    answer_last_calls() before it spins no more; status, if there is one, is the exit status.

    A ValueError, a bad name or a bad parameter while the node is made is a sentence and status 1,
    as are arguments of ROS and parameter files that rclpy cannot read.
    """
    stop = threading.Event()
    _on_signals(leave)
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:   # RCLError, UnknownROSArgsError: rclpy exports neither
        return _refuse(error)
    try:
        node = make_node(stop)
        if hasattr(node, 'begin'):
            node.begin(plain_args(args))
    except (ValueError, NameValidationException, ParameterException) as error:
        rclpy.try_shutdown()
        return _refuse(error)
    _forward_logging(node.get_logger())
    _on_signals(lambda *_: _stop_soon(stop))
    ended = _spin_until(node, stop)
    node.destroy_node()
    rclpy.try_shutdown()
    status = int(getattr(node, 'status', 0))
    if not ended:   # a worker is deep in numpy; nothing of it is needed any more
        leave(status=status)
    return status


def _refuse(error: Exception) -> int:
    """Say in one line why there is no node; return the exit status."""
    told = str(error) if isinstance(error, InputError) else reason_of(error)
    if type(error).__name__ == 'UnknownROSArgsError':   # which rclpy does not export
        told = f'after --ros-args, ROS does not know what {told} means'
    rclpy.logging.get_logger('somfusion_ros').fatal(told)
    return 1


def _on_signals(handler: Callable[..., None]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _stop_soon(stop: threading.Event) -> None:
    """Ask for the end in order, and see to it that it comes."""
    if not stop.is_set():
        last = threading.Timer(LONGEST, leave)
        last.daemon = True
        last.start()
    stop.set()


def plain_args(args: list[str] | None) -> list[str]:
    """Return the command line arguments without the program's name and without those of ROS."""
    return remove_ros_args(sys.argv if args is None else ['', *args])[1:]


def _spin_until(node: Any, stop: threading.Event) -> bool:
    """Spin in a thread until told to stop; return whether all threads ended in time."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=_spin, args=(executor, node, stop), daemon=True)
    thread.start()
    stop.wait()
    if hasattr(node, 'answer_last_calls'):
        node.answer_last_calls()
    executor.shutdown(STOP_TIMEOUT)
    thread.join(STOP_TIMEOUT)
    return node.close(STOP_TIMEOUT) and not thread.is_alive()


def _spin(executor: SingleThreadedExecutor, node: Any, stop: threading.Event) -> None:
    """Run callbacks; an exception in one is said, and the others go on."""
    while not stop.is_set():
        try:
            executor.spin()
        except Exception as error:   # one bad message must not end a robot's node
            if not stop.is_set():
                node.get_logger().error(f'error in a callback: {error!r}')


class _Forward(logging.Handler):
    """Hands what the core logs on to the node's logger."""

    def __init__(self, logger: Any) -> None:
        super().__init__(logging.INFO)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Log one record at its own level."""
        if record.levelno >= logging.ERROR:
            self._logger.error(record.getMessage())
        elif record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def _forward_logging(logger: Any) -> None:
    """Connect the package's logging to ROS."""
    package = logging.getLogger('somfusion_ros')
    package.setLevel(logging.INFO)
    package.addHandler(_Forward(logger))
