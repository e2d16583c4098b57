# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS graph for system tests: node processes, and a client that waits on conditions."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
import time
from typing import Any

from helpers import ros_environment
from pace import patient
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from somfusion_ros.ros.apps.processes import free_domain, Processes

TIMEOUT = 40.0   # [s] for anything to happen; a loaded machine is slow
SETTLED = 0.3    # [s] in which a service sees its new client, whose answer is lost otherwise
UNHEARD = 10.0   # [s] after which a client asks again: on a loaded machine it was not seen yet


class Graph:
    """Node processes in a domain of their own, and a node of the test among them."""

    def __init__(self, processes: Processes, node: Node, executor: SingleThreadedExecutor) -> None:
        self.processes, self.node, self._executor = processes, node, executor
        self.heard: dict[str, list[Any]] = {}

    def start(self, name: str, kind: str, namespace: str, *arguments: str) -> None:
        """Start a node of this package: kind is slam_node, fusion_node or player."""
        self.processes.start(name, f'somfusion_ros.ros.{kind}', [
            '--ros-args', '-r', f'__ns:={namespace}', *arguments])

    def hear(self, kind: type, topic: str, profile: Any) -> list[Any]:
        """Subscribe; the list grows while the graph is spun."""
        messages = self.heard.setdefault(topic, [])
        self.node.create_subscription(kind, topic, messages.append, profile)
        return messages

    def until(self, condition: Callable[[], Any], what: str, timeout: float = TIMEOUT) -> Any:
        """Spin until a condition holds and return its value; fail with the nodes' words."""
        start = time.monotonic()
        while patient(timeout, start) and not any(self.processes.ended().values()):
            value = condition()
            if value:
                return value
            self._executor.spin_once(timeout_sec=0.02)
        words = '\n'.join(f'--- {path.name}\n{path.read_text()[-2000:]}'
                          for path in sorted(self.processes.log_folder.glob('*.log')))
        raise AssertionError(f'not within {timeout} s: {what}\n{words}')

    def spin_for(self, seconds: float) -> None:
        """Spin for a time [s]."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=max(end - time.monotonic(), 0.0))

    def call(self, kind: type, service: str, request: Any = None) -> Any:
        """Call a service, again where nothing is heard, and return its answer."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, f'service {service}')
        self.spin_for(SETTLED)
        calls: list[Future] = []
        asked = -inf

        def answer() -> Any:
            nonlocal asked
            if not patient(UNHEARD, asked):
                asked = time.monotonic()
                calls.append(client.call_async(request or kind.Request()))
            return next((call.result() for call in calls if call.done()), None)

        found = self.until(answer, f'answer of {service}')
        self.node.destroy_client(client)
        return found

    def assert_clean(self, statuses: dict[str, int]) -> None:
        """Check that processes ended with status 0 and without a traceback."""
        for name, code in statuses.items():
            words = self.processes.log_path(name).read_text()
            assert code == 0, f'{name} ended with status {code}: {words[-2000:]}'
            assert 'Traceback' not in words, f'{name}: {words[-3000:]}'
            assert 'error in a callback' not in words, f'{name}: {words[-3000:]}'
            assert 'worker_errors' not in words, f'{name}: {words[-3000:]}'


@contextmanager
def ros_graph(folder: Path, **environment: str) -> Iterator[Graph]:
    """Make a graph, with more in the processes' environment; they end with the block."""
    domain = free_domain()
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node('test_client', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        with Processes(folder / 'logs', ros_environment(domain) | environment) as processes:
            yield Graph(processes, node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
