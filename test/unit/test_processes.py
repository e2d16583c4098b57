# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""No process that the demo starts outlives it, and how each ended is known."""

import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import time

from helpers import ROOT, ros_environment
import pytest
from somfusion_ros.ros.apps.processes import free_domain, node_environment, Processes

SLEEPER = 'import time; time.sleep(60)'
DEAF = ('import signal, time\nfor s in (signal.SIGINT, signal.SIGTERM):\n'
        '    signal.signal(s, signal.SIG_IGN)\nprint("deaf", flush=True)\ntime.sleep(60)')


def alive(pid: int) -> bool:
    """Tell whether a process runs; one that only waits to be reaped does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


@pytest.fixture
def processes(tmp_path: Path) -> Processes:
    """Make modules `sleeper`, `deaf` and `broken` startable."""
    (tmp_path / 'sleeper.py').write_text(SLEEPER)
    (tmp_path / 'deaf.py').write_text(DEAF)
    (tmp_path / 'broken.py').write_text('raise SystemExit("no such laser")')
    environment = {**os.environ, 'PYTHONPATH': str(tmp_path)}
    return Processes(tmp_path / 'logs', environment)


def wait_for(condition: object, timeout: float = 10.0) -> None:
    """Wait until a condition holds, for a bounded time."""
    until = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < until, 'it did not happen in time'
        time.sleep(0.02)


def test_leaving_the_block_ends_all_even_after_an_error(processes: Processes) -> None:
    with pytest.raises(RuntimeError), processes:
        pids = [processes.start(f'sleeper{i}', 'sleeper') for i in range(2)]
        raise RuntimeError
    assert not [pid for pid in pids if alive(pid)]


def test_a_name_started_again_is_ended_again(processes: Processes) -> None:
    with processes:
        for _ in range(2):
            pid = processes.start('sleeper', 'sleeper')
            assert 'sleeper' not in processes.ended()
            assert processes.stop().keys() == {'sleeper'}
            assert not alive(pid)


@pytest.mark.slow
def test_a_process_that_ignores_signals_is_killed(processes: Processes,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('somfusion_ros.ros.apps.processes.STOP_TIMEOUT', 0.3)
    with processes:
        pid = processes.start('deaf', 'deaf')
        wait_for(lambda: 'deaf' in processes.log_path('deaf').read_text())
        assert processes.stop() == {'deaf': -signal.SIGKILL}
    assert not alive(pid)


@pytest.mark.slow
def test_an_early_end_is_known_with_its_reason(processes: Processes) -> None:
    with processes:
        processes.start('broken', 'broken')
        processes.start('sleeper', 'sleeper')
        wait_for(processes.ended)
        assert processes.ended() == {'broken': 1}
        assert processes.last_words('broken') == 'no such laser'


@pytest.mark.skipif(sys.platform != 'linux', reason='needs a call of Linux')
def test_processes_end_with_their_killed_parent(tmp_path: Path) -> None:
    (tmp_path / 'sleeper.py').write_text(SLEEPER)
    parent = (f'import os, time\nfrom somfusion_ros.ros.apps.processes import Processes\n'
              f'p = Processes({str(tmp_path)!r}, {{**os.environ, "PYTHONPATH": '
              f'{str(tmp_path)!r}}})\nprint(p.start("sleeper", "sleeper"), flush=True)\n'
              f'time.sleep(60)')
    process = subprocess.Popen([sys.executable, '-c', parent], stdout=subprocess.PIPE, text=True,
                               env={**os.environ, 'PYTHONPATH': str(ROOT)})
    child = int(process.stdout.readline())
    assert alive(child)
    process.kill()
    process.wait()
    wait_for(lambda: not alive(child))


def test_nodes_get_a_graph_of_their_own() -> None:
    environment = node_environment()
    assert 1 <= int(environment['ROS_DOMAIN_ID']) <= 100
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert node_environment(7)['ROS_DOMAIN_ID'] == '7'
    assert str(ROOT) in ros_environment()['PYTHONPATH']


def test_a_taken_domain_is_passed_over() -> None:
    first = free_domain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(('', 7400 + 250 * first + 10))
        assert free_domain() != first
