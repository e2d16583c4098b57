# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A network that loses, delays, disorders and doubles what robots say, and falls apart.

As over DDS, the newest message of every channel is repeated until it came through, and late
joiners get it; unlike there, an older one may still come after it. Of a log every message comes,
in order, as DDS has it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Any, NamedTuple

import numpy as np

RETRY = 1.0      # [s] after which a message that was lost is sent again


@dataclass
class Conditions:
    """
    How well the network works now.

    loss and doubling: shares of the messages; delay and spread [s]; rate [bytes/s] of all that a
    robot sends; cut: robots that reach only one another.
    """

    loss: float = 0.0
    doubling: float = 0.0
    delay: float = 0.01
    spread: float = 0.01
    rate: float = 1e6
    cut: frozenset[str] = frozenset()


class Message(NamedTuple):
    """What a robot says on a channel; numbers grow with every message."""

    number: int
    payload: Any
    size: int


class Delivery(NamedTuple):
    """A message on its way: when it comes, to whom, from whom, on which channel."""

    at: float
    order: int
    listener: str
    sender: str
    channel: str
    message: Message


class Network:
    """Carries messages between robots, by channel; all chance comes from one generator."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.conditions = Conditions()
        self.sent_bytes = 0
        self._rng = rng
        self._latched: dict[tuple[str, str], Message] = {}
        self._logs: dict[tuple[str, str], list[Message]] = {}
        self._taken: dict[tuple[str, str, str], int] = {}    # of a log, by its listener
        self._busy_until: dict[str, float] = {}
        self._listeners: dict[tuple[str, str], set[str]] = {}
        self._flying: list[Delivery] = []
        self._count = 0

    @property
    def next_at(self) -> float:
        """When the next message comes [s], inf where none is on its way."""
        return self._flying[0].at if self._flying else np.inf

    def reaches(self, one: str, other: str) -> bool:
        """Return whether two robots are on the same side of a cut."""
        cut = self.conditions.cut
        return (one in cut) == (other in cut)

    def recover(self, now: float) -> None:
        """Let the network work well again; what queued up at a slow link goes through at once."""
        self.conditions = Conditions()
        self._busy_until.clear()
        self._flying = [one._replace(at=min(one.at, now + RETRY)) for one in self._flying]
        heapify(self._flying)

    def publish(self, sender: str, channel: str, payload: Any, size: int, now: float,
                log: bool = False) -> None:
        """Send a message to all that listen to a channel; of a log, all are kept for others."""
        message = Message(self._next(), payload, size)
        self._latched[sender, channel] = message
        if log:
            self._logs.setdefault((sender, channel), []).append(message)
        for listener in sorted(self._listeners.get((sender, channel), ())):
            self._send(listener, sender, channel, message, now)

    def subscribe(self, listener: str, sender: str, channel: str, now: float) -> None:
        """Listen to a channel of a robot; what it said last comes at once."""
        listeners = self._listeners.setdefault((sender, channel), set())
        if listener not in listeners:
            listeners.add(listener)
            last = self._latched.get((sender, channel))
            for message in self._logs.get((sender, channel), [last] if last else []):
                self._send(listener, sender, channel, message, now)

    def listened(self, sender: str, channel: str) -> bool:
        """Return whether anybody listens to a channel of a robot."""
        return bool(self._listeners.get((sender, channel)))

    def leave(self, robot: str) -> None:
        """Take a robot off the network: nobody repeats what it said, and it hears nothing."""
        for key in [key for key in self._latched if key[0] == robot]:
            del self._latched[key]
            self._logs.pop(key, None)
        self._taken = {key: taken for key, taken in self._taken.items() if robot not in key[:2]}
        self._flying = [one for one in self._flying if robot not in (one.sender, one.listener)]
        heapify(self._flying)
        for listeners in self._listeners.values():
            listeners.discard(robot)

    def deliver(self, now: float) -> Iterator[Delivery]:
        """Yield what comes through until now [s], in order of time."""
        conditions, rng = self.conditions, self._rng
        while self._flying and self._flying[0].at <= now:
            one = heappop(self._flying)
            newest = self._latched.get((one.sender, one.channel))
            if one.listener not in self._listeners.get((one.sender, one.channel), ()):
                continue
            if not self.reaches(one.sender, one.listener) or rng.random() < conditions.loss:
                key = one.sender, one.channel
                if key in self._logs or (newest and newest.number == one.message.number):
                    heappush(self._flying, one._replace(at=one.at + RETRY, order=self._next()))
                continue
            if (one.sender, one.channel) in self._logs:
                taken = self._taken.get(one[2:5], 0)
                self._taken[one[2:5]] = taken + 1
                yield one._replace(message=self._logs[one.sender, one.channel][taken])
                continue
            if rng.random() < conditions.doubling:
                self._send(one.listener, one.sender, one.channel, one.message, now)
            yield one

    def _send(self, listener: str, sender: str, channel: str, message: Message,
              now: float) -> None:
        """Put a message on its way."""
        conditions = self.conditions
        sent = max(now, self._busy_until.get(sender, now)) + message.size / conditions.rate
        self._busy_until[sender] = sent
        self.sent_bytes += message.size
        takes = conditions.delay + self._rng.exponential(conditions.spread)
        heappush(self._flying, Delivery(sent + takes, self._next(), listener, sender, channel,
                                        message))

    def _next(self) -> int:
        """Return a number that grows."""
        self._count += 1
        return self._count
