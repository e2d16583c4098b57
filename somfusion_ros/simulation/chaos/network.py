# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A network that loses, delays, disorders and doubles what robots say, and falls apart.

As over DDS, the newest message of every channel is repeated until it came through, and late
joiners get it. Unlike there, an older one may still come after it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np

RETRY = 1.0      # [s] after which a message that was lost is sent again


@dataclass
class Conditions:
    """
    How well the network works now.

    loss and doubling: shares of the messages; delay and spread [s]; rate [bytes/s] of a robot;
    cut: robots that reach only one another.
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
        self._listeners: dict[tuple[str, str], set[str]] = {}
        self._flying: list[Delivery] = []
        self._count = 0

    def reaches(self, one: str, other: str) -> bool:
        """Return whether two robots are on the same side of a cut."""
        cut = self.conditions.cut
        return (one in cut) == (other in cut)

    def publish(self, sender: str, channel: str, payload: Any, size: int, now: float) -> None:
        """Send a message to all that listen to a channel."""
        message = Message(self._next(), payload, size)
        self._latched[sender, channel] = message
        for listener in sorted(self._listeners.get((sender, channel), ())):
            self._send(listener, sender, channel, message, now)

    def subscribe(self, listener: str, sender: str, channel: str, now: float) -> None:
        """Listen to a channel of a robot; what it said last comes at once."""
        listeners = self._listeners.setdefault((sender, channel), set())
        if listener not in listeners:
            listeners.add(listener)
            message = self._latched.get((sender, channel))
            if message is not None:
                self._send(listener, sender, channel, message, now)

    def listened(self, sender: str, channel: str) -> bool:
        """Return whether anybody listens to a channel of a robot."""
        return bool(self._listeners.get((sender, channel)))

    def leave(self, robot: str) -> None:
        """Take a robot off the network: nobody repeats what it said, and it hears nothing."""
        for key in [key for key in self._latched if key[0] == robot]:
            del self._latched[key]
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
                if newest is not None and newest.number == one.message.number:
                    heappush(self._flying, one._replace(at=one.at + RETRY, order=self._next()))
                continue
            if rng.random() < conditions.doubling:
                self._send(one.listener, one.sender, one.channel, one.message, now)
            yield one

    def _send(self, listener: str, sender: str, channel: str, message: Message,
              now: float) -> None:
        """Put a message on its way."""
        conditions = self.conditions
        takes = conditions.delay + self._rng.exponential(conditions.spread) + (
            message.size / conditions.rate)
        self.sent_bytes += message.size
        heappush(self._flying, Delivery(now + takes, self._next(), listener, sender, channel,
                                        message))

    def _next(self) -> int:
        """Return a number that grows."""
        self._count += 1
        return self._count
