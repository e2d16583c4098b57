# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The SLAM of several robots, one process each, at most as many at once as there are cores."""

from collections.abc import Mapping
import multiprocessing
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
import os
import signal
import threading
import time
import traceback
from typing import Any

from somfusion_ros.io.bags.log import BagError, Log
from somfusion_ros.io.console import progress_bar
from somfusion_ros.offline.beginning import Beginning
from somfusion_ros.offline.history import History
from somfusion_ros.offline.robot_run import RobotRun, run_robot
from somfusion_ros.slam.config import SlamConfig

STOPPING = (signal.SIGINT, signal.SIGTERM)
TELL_EVERY = 0.2   # [s] between two words of progress from a process


def run_robots(logs: Mapping[str, Log], config: SlamConfig | None = None,
               jobs: int | None = None, period: float | None = None,
               beginning: Beginning | None = None) -> dict[str, RobotRun]:
    """
    Run the SLAM of every robot; the results do not depend on the number of jobs.

    jobs: processes at once, default one per core; with one job all runs in this process.
    period: time [s] between two maps of the history, None keeps no history.
    beginning: the map that a single robot goes on in.
    """
    jobs = min(len(logs), jobs or os.cpu_count() or 1)
    bars = {name: progress_bar(name, log.scan_count, 'scan', position)
            for position, (name, log) in enumerate(logs.items())}
    try:
        if jobs == 1:
            return {name: run_robot(log, config, bars[name].update, _history(period), beginning)
                    for name, log in logs.items()}
        return _run_parallel(logs, config, jobs, period, bars)
    finally:
        for bar in bars.values():
            bar.close()


def _run_parallel(logs: Mapping[str, Log], config: SlamConfig | None, jobs: int,
                  period: float | None, bars: Mapping[str, Any]) -> dict[str, RobotRun]:
    """Keep `jobs` processes at work until every log is done; stop all when one fails."""
    context = multiprocessing.get_context('spawn')
    left = list(logs)
    running: dict[Any, tuple[str, BaseProcess]] = {}   # by connection
    results: dict[str, RobotRun] = {}
    try:
        while left or running:
            while left and len(running) < jobs:
                name = left.pop(0)
                here, there = context.Pipe(duplex=False)
                process = context.Process(target=_work, daemon=True,
                                          args=(there, logs[name], config, period))
                running[here] = (name, process)
                _start(process)
                there.close()
            for connection in wait(list(running)):
                name, worker = running[connection]
                kind, value = _receive(connection, logs[name])
                if kind == 'progress':
                    bars[name].update(value)
                else:
                    results[name] = value
                    del running[connection]
                    worker.join()
    finally:
        for _, worker in running.values():
            if worker.pid is not None:
                worker.kill()   # it has nothing to save
                worker.join()
    return {name: results[name] for name in logs}


def _start(process: BaseProcess) -> None:
    """
    Start a process that takes no signal: Ctrl-C also reaches this one, which ends all.

    A signal that comes before the process has all that it is started with is heeded after that.
    """
    came: list[object] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():   # only this may set handlers
        handlers = {number: signal.signal(number, lambda *_: came.append(_))
                    for number in STOPPING if callable(signal.getsignal(number))}
    resource_tracker.ensure_running()   # where it is begun with the process, signals get through
    signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)   # the process inherits what is blocked
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt


def _receive(connection: Any, log: Log) -> tuple[str, Any]:
    """Receive a word from a process; BagError where its log is damaged or the process died."""
    try:
        kind, value = connection.recv()
    except EOFError:
        raise BagError(f'{log.path}: the process at work on it ended early '
                       '(out of memory?)') from None
    if kind == 'error':
        raise BagError(value)
    if kind == 'crash':
        raise RuntimeError(f'{log.path}: the SLAM failed\n{value}')
    return kind, value


def _history(period: float | None) -> History | None:
    """Make a history to be filled, if one is asked for."""
    return None if period is None else History(period)


def _work(connection: Connection, log: Log, config: SlamConfig | None,
          period: float | None) -> None:
    """Run one log in a process of its own."""
    done, last = 0, time.monotonic()

    def progress(count: int) -> None:
        nonlocal done, last
        done += count
        if time.monotonic() - last > TELL_EVERY:
            connection.send(('progress', done))
            done, last = 0, time.monotonic()

    try:
        run = run_robot(log, config, progress, _history(period))
        connection.send(('progress', done))
        connection.send(('done', run))
    except BagError as error:
        connection.send(('error', str(error)))
    except Exception:
        connection.send(('crash', traceback.format_exc()))
