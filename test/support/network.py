# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots as network namespaces, joined by a switch that can be made as bad as a radio."""

from collections.abc import Mapping, Sequence
import ctypes
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
from types import TracebackType
from typing import Any

import pytest

SUBNET = '10.77.0.{}'
SWITCH = str(Path(__file__).with_name('switch.py'))
PR_SET_PDEATHSIG = 1
TOOLS = ('unshare', 'nsenter', 'setpriv', 'ip', 'mount')
TIMEOUT = 20.0   # [s] for a tool or the switch to answer


def need_namespaces() -> None:
    """Skip the calling module where the kernel forbids network namespaces; never on CI."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    reason = f'{", ".join(missing)} not installed' if missing else _why_forbidden()
    if reason:
        assert os.environ.get('CI', '').lower() not in ('1', 'true', 'yes'), reason
        pytest.skip(f'no network namespaces here: {reason}', allow_module_level=True)


def _why_forbidden() -> str:
    """Say what the kernel forbids; nothing where namespaces can be made."""
    tried = subprocess.run(['unshare', '-n', '-m', 'ip', 'link', 'set', 'lo', 'up'],
                           capture_output=True, text=True, timeout=TIMEOUT)
    return tried.stderr.strip() if tried.returncode else ''


class Host:
    """A namespace with a network and a shared memory of its own, held open by a process."""

    def __init__(self) -> None:
        self._holder = subprocess.Popen(
            ['unshare', '-n', '-m', 'sh', '-c', 'mount -t tmpfs tmpfs /dev/shm && '
             'ip link set lo up && echo ready && exec sleep infinity'],
            stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent)
        assert self._holder.stdout.readline() == 'ready\n', 'the namespace cannot be set up'

    @property
    def process(self) -> int:
        """Process id that stands for the namespace."""
        return self._holder.pid

    @property
    def prefix(self) -> list[str]:
        """Words before a command that make it run in here."""
        return ['nsenter', '-t', str(self.process), '-n', '-m', 'setpriv', '--pdeathsig', 'KILL']

    def run(self, *command: str) -> None:
        """Run a short command in here."""
        subprocess.run([*self.prefix, *command], check=True, timeout=TIMEOUT, capture_output=True)

    def close(self) -> None:
        """Let the namespace go, and the interfaces with it."""
        self._holder.kill()
        self._holder.wait()
        self._holder.stdout.close()


class Network:
    """Hosts 0..count-1, each with the address 10.77.0.<number + 1>, on one switch."""

    def __init__(self, count: int) -> None:
        self._hub = Host()
        self.hosts = [Host() for _ in range(count)]
        ports = [f'port{number}' for number in range(count)]
        for number, (host, port) in enumerate(zip(self.hosts, ports, strict=True)):
            hub, there = str(self._hub.process), str(host.process)
            subprocess.run(['ip', 'link', 'add', port, 'netns', hub, 'type', 'veth',
                            'peer', 'name', 'eth0', 'netns', there], check=True)
            self._hub.run('ip', 'link', 'set', port, 'up')
            host.run('ip', 'address', 'add', f'{SUBNET.format(number + 1)}/24', 'dev', 'eth0')
            host.run('ip', 'link', 'set', 'eth0', 'up')
            host.run('ip', 'route', 'add', 'default', 'dev', 'eth0')
            host.run(sys.executable, SWITCH, '--compute-checksums', 'eth0')
        self._switch = subprocess.Popen(
            [*self._hub.prefix, sys.executable, SWITCH, *ports], text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, preexec_fn=die_with_parent)
        self.change()

    def __enter__(self) -> 'Network':
        """Begin with a perfect network."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Take it all down."""
        self._switch.communicate(timeout=TIMEOUT)
        for host in (*self.hosts, self._hub):
            host.close()

    def change(self, **settings: Any) -> list[int]:
        """Change the links, see switch.py; return the bytes that each host sent so far."""
        self._switch.stdin.write(json.dumps(settings) + '\n')
        self._switch.stdin.flush()
        return json.loads(self._switch.stdout.readline())

    def heal(self) -> None:
        """Make the network perfect again."""
        self.change(loss=0.0, duplicate=0.0, reorder=0.0, rate=0.0, groups=[])


def die_with_parent() -> None:
    """Ask Linux to end this process when its parent dies."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def on_network(environment: Mapping[str, str], profile: Path | None = None) -> dict[str, str]:
    """Make the environment of nodes that look beyond their own host, with a Fast DDS profile."""
    found = {**environment, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DOMAIN_ID': '7'}
    if profile is not None:
        found |= {'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
                  'FASTDDS_DEFAULT_PROFILES_FILE': str(profile)}
    return found


def partition(count: int, *groups: Sequence[int]) -> list[list[int]]:
    """List groups of hosts that reach one another; who is named in none is alone."""
    named = {number for group in groups for number in group}
    return [list(group) for group in groups] + [[n] for n in range(count) if n not in named]
