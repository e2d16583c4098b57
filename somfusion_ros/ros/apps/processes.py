# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Node processes with a ROS graph of their own, each ended by its own id whatever happens."""

from collections import deque
from collections.abc import Mapping, Sequence
import ctypes
import os
from pathlib import Path
import random
import signal
import socket
import subprocess
import sys
import time
from types import TracebackType

STOP_TIMEOUT = 6.0   # [s] for each of SIGINT and SIGTERM, before SIGKILL
PR_SET_PDEATHSIG = 1   # of Linux: a signal for the child when its parent dies
FIRST_PORT, PORTS_PER_DOMAIN, UNICAST = 7400, 250, 10   # of the DDSI-RTPS standard
_HELD: deque[socket.socket] = deque(maxlen=8)   # of the domains that this process got last
HIGHEST_DOMAIN = 100   # above it, ports fall into the range of outgoing connections


def free_domain() -> int:
    """
    Find a ROS domain (1..100) in which nothing on this machine listens right now.

    This process holds the domain's last port, which no node reaches, so that no other program
    that asks takes the same domain before the first node is there; old ones are given back.
    """
    domains = list(range(1, HIGHEST_DOMAIN + 1))
    random.Random(os.getpid()).shuffle(domains)   # so that two programs rarely try the same
    for domain in domains:
        first = FIRST_PORT + PORTS_PER_DOMAIN * domain
        held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            held.bind(('', first + PORTS_PER_DOMAIN - 1))
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(('', first + UNICAST))
        except OSError:
            held.close()
            continue
        _HELD.append(held)
        return domain
    raise OSError('every ROS domain of this machine is taken')


def node_environment(domain: int | None = None) -> dict[str, str]:
    """Return an environment for nodes: own domain, this machine, Fast DDS, one thread."""
    return {**os.environ,
            'OMP_NUM_THREADS': '1',
            'OPENBLAS_NUM_THREADS': '1',
            'PYTHONUNBUFFERED': '1',
            'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp',
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_DOMAIN_ID': str(free_domain() if domain is None else domain)}


class Processes:
    """Several node processes, each with a log file; leaving the `with` block ends all of them."""

    def __init__(self, log_folder: str | Path, environment: Mapping[str, str]) -> None:
        self.log_folder = Path(log_folder)
        self.log_folder.mkdir(parents=True, exist_ok=True)
        self._environment = dict(environment)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.statuses: dict[str, int] = {}

    def __enter__(self) -> 'Processes':
        """Begin with no process."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """End every process that still runs."""
        self.stop()

    def start(self, name: str, module: str, arguments: Sequence[str] = ()) -> int:
        """Start `python -m module arguments` and return its process id."""
        with self.log_path(name).open('wb') as log:
            process = subprocess.Popen(
                [sys.executable, '-m', module, *arguments], env=self._environment, stdout=log,
                stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, preexec_fn=_end_with_parent)
        self._running[name] = process
        self.statuses.pop(name, None)   # of an earlier process of this name
        return process.pid

    def log_path(self, name: str) -> Path:
        """Return where a process writes what it says."""
        return self.log_folder / f'{name}.log'

    def last_words(self, name: str) -> str:
        """Return the last line that a process wrote."""
        lines = self.log_path(name).read_text(errors='replace').strip().splitlines()
        return lines[-1] if lines else 'it said nothing'

    def ended(self) -> dict[str, int]:
        """Return the exit statuses of the processes that have ended, by name."""
        for name, process in list(self._running.items()):
            if process.poll() is not None:
                self.statuses[name] = process.returncode
                del self._running[name]
        return dict(self.statuses)

    def kill(self, name: str) -> None:
        """End one process at once, as a power cut would; its status is not kept."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def stop(self, names: Sequence[str] | None = None) -> dict[str, int]:
        """End some or all processes: SIGINT, then SIGTERM, then SIGKILL; return statuses."""
        chosen = [n for n in (list(self._running) if names is None else names)
                  if n in self._running]
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for name in chosen:
                if name not in self.ended():
                    self._running[name].send_signal(number)
            self._wait(chosen, STOP_TIMEOUT)
        return {name: self.statuses[name] for name in chosen if name in self.statuses}

    def _wait(self, names: Sequence[str], timeout: float) -> None:
        """Wait until all of these have ended, for a bounded time."""
        until = time.monotonic() + timeout
        while set(names) - self.ended().keys() and time.monotonic() < until:
            time.sleep(0.05)


def _end_with_parent() -> None:
    """Ask Linux to end this process when its parent dies, even by SIGKILL."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    except (OSError, AttributeError):   # other systems have no such call
        pass
