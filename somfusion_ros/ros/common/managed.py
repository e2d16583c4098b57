# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A node with the life cycle that Nav2's lifecycle_manager drives, and services that always answer.

Unconfigured, it has its parameters only. Configuring loads what it starts from and creates its
publishers and services; activating creates its subscriptions and timers and starts its threads.
The ways back undo just that. With `autostart` it takes both steps by itself.
"""

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from somfusion_ros.io.errors import sentence
from somfusion_ros.ros.common.diagnostics import Faults
from somfusion_ros.ros.common.entities import Entities
from somfusion_ros.ros.common.parameters import warn_of_unknown

LOOK_PERIOD = 1.0             # [s] between two looks at the clock
PATIENCE = 2.0                # [s] without a clock before that is said
DEACTIVATION_TIMEOUT = 30.0   # [s] that the threads are given to finish their piece of work
LAST_CALLS = 0.5              # [s] that calls which wait are given when the process ends
ANSWER_TIME = 0.1             # [s] for an answer to leave
Answer = tuple[bool, str]     # whether a job went well, and its result or the reason


class ManagedNode(LifecycleNode):
    """Base of both nodes; they define the four steps and the thread that serves."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.active = False
        self._count = Faults(self.get_logger())
        self.configured_part, self.active_part = Entities(self), Entities(self)
        # A group of its own: while a service waits for a thread, the other callbacks go on.
        self._waiting = MutuallyExclusiveCallbackGroup()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)   # goes on in a paused simulation
        self._pending: set[Future] = set()
        self._failure, self._reports = '', True   # why a step failed; whether that is logged

    def configure(self) -> None:
        """Load what the node starts from, and create its publishers and services."""

    def activate(self) -> None:
        """Create subscriptions and timers, and start the threads."""

    def deactivate(self, timeout: float) -> bool:
        """Stop the threads; return whether they ended in time."""
        return True

    def clean_up(self) -> None:
        """Forget what configuring loaded."""

    def submit(self, job: Callable[[], Any]) -> None:
        """Run a job soon in the thread that serves."""
        job()

    def count_error(self, error: Exception) -> None:
        """Count an error that nobody foresaw."""
        self._count('worker_errors', repr(error))

    @property
    def without_clock(self) -> str:
        """Say that the node is to take the time from /clock, and none has come; else ''."""
        waits = self.get_parameter('use_sim_time').value and not self.get_clock().now().nanoseconds
        return 'use_sim_time is true, but nothing has come on /clock' if waits else ''

    def look_at_clock(self) -> None:
        """Count where the node is to take the time from /clock, and none has come."""
        if self.without_clock:
            self._count('seconds_without_clock', self.without_clock, PATIENCE)

    def begin(self, arguments: list[str]) -> None:
        """
        Name what was given in vain, then configure and activate, unless a manager is to do it.

        arguments: of the command line, that ROS did not take.
        """
        for argument in arguments:
            hint = ': parameters follow --ros-args -p' if ':=' in argument else ''
            self.get_logger().warning(f'the argument {argument} has no effect{hint}')
        warn_of_unknown(self)
        if self.get_parameter('autostart').value:
            self.autostart()

    def autostart(self) -> None:
        """Configure and activate; ValueError with the reason, not logged, where that fails."""
        self._reports = False
        done = self.trigger_configure()
        if done is TransitionCallbackReturn.SUCCESS:
            done = self.trigger_activate()
        if done is not TransitionCallbackReturn.SUCCESS:
            raise ValueError(self._failure)
        self._reports = True

    def close(self, timeout: float) -> bool:
        """Stop the threads at the end of the process; return whether they ended in time."""
        return self.deactivate(timeout) if self.active else True

    def answer_last_calls(self) -> None:
        """Wait for calls of services, while others spin; those that take long are refused."""
        if not self._pending:
            return
        self._wait_for_calls(LAST_CALLS)
        for done in tuple(self._pending):
            self._answer(done, (False, 'the node is ending'))
        self._wait_for_calls(LAST_CALLS)
        time.sleep(ANSWER_TIME)

    def _wait_for_calls(self, timeout: float) -> None:
        """Wait until no call waits any more, for a time [s]."""
        until = time.monotonic() + timeout
        while self._pending and time.monotonic() < until:
            time.sleep(0.1 * ANSWER_TIME)

    def every(self, period: float, callback: Callable[[], None]) -> None:
        """Call back by a steady clock [s] while the node is active."""
        self.active_part.create_timer(period, callback, clock=self._steady)

    def serve(self, kind: type, name: str, job: Callable[[Any], str]) -> None:
        """
        Create a service; its job takes the request in the thread that serves.

        The job returns what came of it, or raises OSError or ValueError with the reason.
        """
        self.configured_part.create_service(kind, name, partial(self._serve, job),
                                            callback_group=self._waiting)

    async def _serve(self, job: Callable[[Any], str], request: Any, response: Any) -> Any:
        """Have the thread do a job, and wait for it; callbacks go on meanwhile."""
        if self.active:
            done = Future(executor=self.executor)
            self._pending.add(done)
            self.submit(lambda: self._answer(done, self._outcome(partial(job, request))))
            success, message = await done
            self._pending.discard(done)
        else:
            success, message = False, 'the node is not active'
        if success:
            self.get_logger().info(message)
        else:   # a line of its own: rclpy wants one severity per line
            self.get_logger().warning(message)
        if hasattr(response, 'message'):
            response.success, response.message = success, message
        else:   # nav2_msgs
            response.result = success
        return response

    def _answer(self, done: Future, answer: Answer) -> None:
        """Answer a call that waits, at once, unless that was done."""
        if not done.done():
            done.set_result(answer)
            if self.executor is not None:
                self.executor.wake()     # else it looks when something else happens

    def _outcome(self, job: Callable[[], str]) -> Answer:
        """Run the job of a service; whatever happens, there is an answer."""
        try:
            return True, job()
        except (OSError, ValueError) as error:
            return False, sentence(error)
        except Exception as error:   # the caller waits
            self.count_error(error)
            return False, f'this failed unexpectedly: {error!r}'

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from unconfigured to inactive."""
        return self._step(self.configure, self._undo_configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to active."""
        self.active = True
        self.every(LOOK_PERIOD, self.look_at_clock)
        return self._step(self.activate, self._undo_activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from active to inactive; everything built is kept."""
        return self._step(self._undo_activate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to unconfigured."""
        return self._step(self._undo_configure)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from any state to finalized."""
        return self._step(self._undo_all)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured after a step that failed."""
        return self._step(self._undo_all)

    def _undo_activate(self) -> None:
        self.active = False
        self.active_part.destroy_all()
        self.deactivate(DEACTIVATION_TIMEOUT)
        for done in tuple(self._pending):
            self._answer(done, (False, 'the node was deactivated'))

    def _undo_configure(self) -> None:
        self.configured_part.destroy_all()
        self.clean_up()

    def _undo_all(self) -> None:
        if self.active:
            self._undo_activate()
        self._undo_configure()

    def _step(self, step: Callable[[], None],
              undo: Callable[[], None] = lambda: None) -> TransitionCallbackReturn:
        """Run one step of the life cycle; log, undo and report a failure."""
        try:
            step()
        except Exception as error:
            self._failure = sentence(error) if isinstance(error, (OSError, ValueError)) else (
                repr(error))
            if self._reports:
                self.get_logger().error(self._failure)
            undo()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS
