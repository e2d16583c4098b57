# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages that wait, unread, until the worker has time for them: few, however fast they come.

Of every channel of every robot the newest waits. What was read, and speaks of a map that is not
known to live yet, waits apart: an older message that comes late must not take its place.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from somfusion_ros.team.channels import CHANGES, MAP, STATE

EARLY = {MAP: 2, CHANGES: 2}     # that wait for the word on their map; else one

Address = tuple[str, str]    # a robot, and a channel of it


class Waiting(NamedTuple):
    """A message that nobody has read yet, and what reads it or raises ValueError."""

    message: Any
    read: Callable[[Any], Any]
    rank: int = 0


class Unread:
    """Keeps messages by robot and channel."""

    def __init__(self) -> None:
        self._fresh: dict[Address, Waiting] = {}
        self._early: dict[Address, tuple[Waiting, ...]] = {}

    def keep(self, robot: str, channel: str, waiting: Waiting) -> None:
        """Keep a message, unless one of a higher rank overtook it and is not read yet."""
        before = self._fresh.get((robot, channel))
        if before is None or waiting.rank >= before.rank:
            self._fresh[robot, channel] = waiting

    def keep_early(self, robot: str, channel: str, waiting: Waiting) -> None:
        """Keep a message that was read too early; of too many, the one that came first goes."""
        early = *self._early.get((robot, channel), ()), waiting
        self._early[robot, channel] = early[-EARLY.get(channel, 1):]

    def count(self, robot: str, kind: str) -> int:
        """Count the channels of a kind, of one robot, on which something waits."""
        return sum(one == robot and channel.startswith(kind) for one, channel in self._all())

    def forget(self, robot: str) -> None:
        """Forget all that waits of a robot."""
        for address in [address for address in self._all() if address[0] == robot]:
            self._fresh.pop(address, None)
            self._early.pop(address, None)

    def addresses(self) -> list[Address]:
        """Return where something waits: states first, for they say which maps live."""
        return sorted(self._all(), key=lambda one: (one[1] != STATE, one))

    def take(self, robot: str, channel: str) -> list[Waiting]:
        """Take what waits of a channel, as it came."""
        fresh = self._fresh.pop((robot, channel), None)
        early = self._early.pop((robot, channel), ())
        return [*(early if fresh is None or channel in EARLY else ()), *([fresh] if fresh else ())]

    def _all(self) -> set[Address]:
        return {*self._fresh, *self._early}     # in one step each: other threads add to them
