# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The thread beside the callbacks: jobs in order, faults, and an end in time."""

import threading

from somfusion_ros.ros.common.worker import Worker


def test_a_worker_does_jobs_in_order_and_survives_a_failing_one() -> None:
    done, errors, finished = [], [], threading.Event()
    worker = Worker(lambda: False, errors.append, period=0.01)
    worker.start()
    worker.submit(lambda: done.append(1))
    worker.submit(lambda: 1 / 0)
    worker.submit(lambda: done.append(2))
    worker.submit(finished.set)
    assert finished.wait(5.0)
    assert done == [1, 2]
    assert isinstance(errors[0], ZeroDivisionError)
    assert worker.close(5.0)


def test_a_worker_goes_on_while_there_is_more_and_takes_jobs_in_between() -> None:
    left, asked = [5], threading.Event()

    def idle() -> bool:
        left[0] -= 1
        return left[0] > 0
    worker = Worker(idle, lambda error: None, period=60.0)
    worker.submit(lambda: None)
    worker.start()
    worker.submit(asked.set)
    assert asked.wait(5.0)
    assert worker.close(5.0)
    assert left[0] <= 4


def test_a_worker_that_is_busy_says_so() -> None:
    busy, release = threading.Event(), threading.Event()

    def job() -> None:
        busy.set()
        release.wait(30.0)
    worker = Worker(lambda: False, lambda error: None)
    worker.start()
    worker.submit(job)
    assert busy.wait(5.0)
    assert not worker.close(0.05)
    release.set()
    assert worker.close(5.0)
