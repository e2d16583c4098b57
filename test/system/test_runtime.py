# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's process ends within five seconds of a signal, whatever it is doing."""

import signal
import subprocess
import sys
import time

from helpers import need_ros, ros_environment
from pace import patient
import pytest

need_ros()
pytestmark = pytest.mark.system
NODE = """
import sys, time
from rclpy.node import Node
from somfusion_ros.ros.common.runtime import run

def slow(when):
    if when == sys.argv[1]:
        print('busy', flush=True)
        time.sleep(120.0)

class Slow(Node):

    def __init__(self):
        super().__init__('slow_node')
        slow('made')

    def begin(self, arguments):
        slow('begun')
        self.create_timer(0.01, lambda: slow('spun'))
        if sys.argv[1] == 'closed':
            print('busy', flush=True)

    def close(self, timeout):
        if sys.argv[1] == 'closed':
            time.sleep(120.0)
        return True

raise SystemExit(run(lambda stop: Slow(), []))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize('when', ['made', 'begun', 'spun', 'closed'])
def test_a_node_ends_soon_after_a_signal_whatever_it_does(when: str, number: int) -> None:
    node = subprocess.Popen([sys.executable, '-c', NODE, when], env=ros_environment(),
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert node.stdout is not None and node.stdout.readline() == 'busy\n'
        time.sleep(0.2)   # into the work, and past the setting of handlers
        node.send_signal(number)
        told = time.monotonic()
        while node.poll() is None and patient(5.0, told):
            time.sleep(0.02)
        assert node.returncode == 0
        assert node.communicate()[1] == ''
    finally:
        node.kill()


@pytest.mark.parametrize('arguments', [['--params-file', 'none.yaml'], ['-p', 'resolution']])
def test_what_rclpy_cannot_read_is_said_in_the_last_line(arguments: list[str]) -> None:
    code = ('import sys; from somfusion_ros.ros.common.runtime import run; '
            'raise SystemExit(run(lambda stop: None, sys.argv[1:]))')
    done = subprocess.run([sys.executable, '-c', code, '--ros-args', *arguments],
                          env=ros_environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert 'Traceback' not in done.stderr
    assert arguments[-1] in done.stderr.splitlines()[-1]
