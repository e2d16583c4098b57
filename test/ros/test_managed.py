# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A managed node gives back what a state created, and answers whatever happens in a service."""

from collections.abc import Iterator
from threading import Event, Thread
from types import SimpleNamespace
from typing import Any

from helpers import need_ros
import pytest

need_ros()

import rclpy  # noqa: E402, I100
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from somfusion_ros.ros.common import qos  # noqa: E402
from somfusion_ros.ros.common.entities import Entities  # noqa: E402
from somfusion_ros.ros.common.managed import ManagedNode  # noqa: E402
from somfusion_ros.ros.common.runtime import _spin_until  # noqa: E402
from somfusion_ros.ros.fusion.node import FusionNode  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402


@pytest.fixture
def node(ros_domain: int) -> Iterator[ManagedNode]:
    """Make a managed node that does nothing."""
    rclpy.init()
    made = ManagedNode('managed')
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


def test_entities_are_destroyed_once_alone_or_together(node: ManagedNode) -> None:
    part = Entities(node)
    before = [len(list(kind)) for kind in (node.publishers, node.subscriptions, node.timers,
                                           node.services)]
    one = part.create_publisher(String, 'one', qos.LATCHED)
    part.create_publisher(String, 'two', qos.LATCHED)
    part.create_subscription(String, 'three', lambda _: None, qos.LATCHED)
    part.create_timer(1.0, lambda: None)
    part.create_service(Trigger, 'four', lambda request, response: response)
    part.destroy_publisher(one)
    for _ in range(2):
        part.destroy_all()
        assert [len(list(kind)) for kind in (node.publishers, node.subscriptions, node.timers,
                                             node.services)] == before
    assert part.get_name() == 'managed'   # all else is the node's own


@pytest.mark.parametrize(('error', 'words'), [
    (ValueError('too large'), 'too large'), (OSError(28, 'No space left'), 'No space left'),
    (MemoryError('out of it'), 'unexpectedly'), (KeyError('robot2'), 'robot2')])
def test_an_answer_always_comes(error: Exception, words: str, node: ManagedNode) -> None:
    counted: list[Exception] = []
    node.count_error = counted.append

    def job() -> str:
        raise error
    success, message = node._outcome(job)
    assert not success
    assert words in message
    assert bool(counted) == isinstance(error, (MemoryError, KeyError))


def test_a_step_that_fails_is_undone(node: ManagedNode) -> None:
    def configure() -> None:
        node.configured_part.create_publisher(String, 'half', qos.LATCHED)
        raise ValueError('not today')
    node.configure = configure
    before = len(list(node.publishers))
    assert node.trigger_configure() is TransitionCallbackReturn.FAILURE
    assert len(list(node.publishers)) == before
    with pytest.raises(ValueError, match='not today'):
        node.autostart()


def test_a_fusion_node_whose_activation_fails_can_be_activated_again(
        ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rclpy.init(args=['--ros-args', '-r', '__ns:=/robot1', '-p', 'autostart:=false'])
    node = FusionNode()
    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS
    with monkeypatch.context() as patched:
        patched.setattr('somfusion_ros.ros.fusion.node.Discovery', lambda *_: 1 / 0)
        assert node.trigger_activate() is TransitionCallbackReturn.FAILURE
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    assert node.close(5.0)
    node.destroy_node()
    rclpy.try_shutdown()


def test_why_a_node_does_not_start_is_said_once(node: ManagedNode,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    """By the process, in its last line; a manager, who starts it later, reads it in the log."""
    said: list[str] = []
    monkeypatch.setattr(node, 'get_logger', lambda: SimpleNamespace(error=said.append))

    def configure() -> None:
        raise ValueError('not today')
    node.configure = configure
    assert node.trigger_configure() is TransitionCallbackReturn.FAILURE
    assert said == ['not today']
    with pytest.raises(ValueError, match='not today'):
        node.autostart()
    assert said == ['not today']


def test_calls_that_wait_are_answered_when_the_node_is_deactivated(node: ManagedNode) -> None:
    node.autostart()
    node.submit = lambda job: None   # a thread that never gets to it
    answered: list[Any] = []
    task = node._serve(lambda request: 'done', None, Trigger.Response())
    waiting = task.send(None)
    assert waiting is None or not answered
    node.trigger_deactivate()
    with pytest.raises(StopIteration) as ended:
        task.send(None)
    assert not ended.value.value.success
    assert 'deactivated' in ended.value.value.message


@pytest.mark.parametrize(('job_ends', 'words'), [(True, 'done'), (False, 'the node is ending')])
def test_calls_that_wait_are_answered_when_the_process_ends(job_ends: bool, words: str,
                                                            node: ManagedNode) -> None:
    """A client would wait for ever; a job that is nearly done is waited for."""
    node.autostart()
    node.serve(Trigger, 'work', lambda request: 'done')
    jobs: list[Any] = []
    node.submit = jobs.append
    caller, theirs, stop = rclpy.create_node('caller'), SingleThreadedExecutor(), Event()
    theirs.add_node(caller)
    client = caller.create_client(Trigger, 'work')
    spinning = Thread(target=_spin_until, args=(node, stop))
    spinning.start()
    assert client.wait_for_service(10.0)
    answer = client.call_async(Trigger.Request())
    while not jobs:
        theirs.spin_once(0.01)
    stop.set()
    if job_ends:
        jobs[0]()
    theirs.spin_until_future_complete(answer, 5.0)
    spinning.join()
    assert answer.done() and words in answer.result().message
    jobs[0]()      # too late: nobody minds
    caller.destroy_node()


def test_a_clock_that_does_not_come_is_named(node: ManagedNode) -> None:
    """Forgotten in a simulation as often as it is set on a robot."""
    node.look_at_clock()
    assert not node._count.counts()
    node.set_parameters([Parameter('use_sim_time', value=True)])
    node.look_at_clock()
    assert node._count.counts() == {'seconds_without_clock': 1}
