# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A thread for heavy work, so that no callback ever waits for it."""

from collections.abc import Callable
import queue
import threading
import time
from typing import Any


class Worker:
    """
    Runs submitted jobs in order, and an idle step in between.

    `idle` does one bounded piece of background work and returns whether there is more; it is
    called again at once then, else after `period` seconds or a new job.
    """

    def __init__(self, idle: Callable[[], bool], on_error: Callable[[Exception], Any],
                 period: float = 0.1) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], Any]] = queue.SimpleQueue()
        self._idle, self._on_error, self._period = idle, on_error, period
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def stopping(self) -> bool:
        """Whether the thread was told to stop."""
        return self._stop.is_set()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def submit(self, job: Callable[[], Any]) -> None:
        """Run a job soon, after those submitted before."""
        self._jobs.put(job)

    def wake(self) -> None:
        """Run the idle step now."""
        if self._jobs.empty():
            self._jobs.put(lambda: None)

    def close(self, timeout: float) -> bool:
        """Stop after the present job; return whether the thread ended in time."""
        self._stop.set()
        self._jobs.put(lambda: None)
        if self._thread.is_alive():
            self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        more = False
        while not self._stop.is_set():
            try:
                self._take_jobs(0.0 if more else self._period)
                more = not self._stop.is_set() and self._idle()
            except Exception as error:   # one failed job must not end the others
                more = False
                if not self._stop.is_set():
                    self._on_error(error)

    def _take_jobs(self, timeout: float) -> None:
        """Run the jobs that are there, waiting a while for the first."""
        until = time.monotonic() + timeout
        while not self._stop.is_set():
            left = until - time.monotonic()
            try:
                job = self._jobs.get(left > 0, max(left, 0.0))
            except queue.Empty:
                return
            until = 0.0
            job()
