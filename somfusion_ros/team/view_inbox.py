# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots tell of their paths and of bonds, until the worker has time for it."""

from collections import deque
from collections.abc import Callable, Collection, Mapping
from threading import Lock

from somfusion_ros.team.bond_message import BondHearer, BondMessage
from somfusion_ros.team.channels import BONDS, VIEWS
from somfusion_ros.team.elastic_session import ElasticSession
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.kept_views import decode_kept
from somfusion_ros.team.view_store import MOST_BYTES

MOST_BATCHES = 4096      # of one robot's path that wait; more are refused


class ViewInbox:
    """
    Keeps every batch of views, and the newest bonds of every robot.

    absent: who is gone, so that others may speak for it; by default everybody.
    """

    def __init__(self, elastic: ElasticSession, heard: Mapping[str, Heard],
                 count: Callable[..., None], clock: Callable[[], float],
                 absent: Callable[[], Collection[str]] | None = None) -> None:
        self._elastic, self._heard, self._count, self._clock = elastic, heard, count, clock
        self._absent = absent
        self._batches: dict[str, deque[bytes]] = {}
        self._handed_on: dict[str, bytes] = {}     # bonds of robots that are gone
        self._hearer = BondHearer()
        self._lock = Lock()     # of what waits: messages come in another thread than takes them

    def keep_batch(self, robot: str, data: bytes) -> None:
        """Keep what a robot told of its path; every batch counts."""
        self._note(robot, VIEWS, data)
        with self._lock:
            waiting = self._batches.get(robot, deque())
            full = (f'over {MOST_BYTES} bytes wait' if sum(map(len, [*waiting, data])) > MOST_BYTES
                    else f'over {MOST_BATCHES} batches wait' if len(waiting) >= MOST_BATCHES
                    else '')
            if not full:
                waiting.append(data)
                self._batches[robot] = waiting
        if full:
            self._count(f'{VIEWS}_of_{robot}_unusable', full)

    def keep_bonds(self, robot: str, data: bytes) -> None:
        """Keep the bonds that a robot tells now, unless it told others since."""
        self._note(robot, BONDS, data)
        try:
            message = BondMessage.decode(data)
        except ValueError as error:
            self._count(f'{BONDS}_of_{robot}_unusable', str(error))
            return
        with self._lock:
            self._hearer.keep(robot, message)

    def keep_kept(self, robot: str, data: bytes) -> None:
        """
        Keep what another robot handed on of one that is gone.

        It may be late. Of a robot that is back nothing is taken: what it told before it was
        started anew would put out what it tells now, and it does not tell its views twice. Bonds
        that the robot told itself, also that it has none, stay.
        """
        if self._absent is not None and robot not in self._absent():
            return
        try:
            batches, bonds = decode_kept(data)
        except ValueError as error:
            self._count(f'{VIEWS}_of_{robot}_unusable', str(error))
            return
        for batch in batches:
            self.keep_batch(robot, batch)
        if bonds and robot not in self._hearer.robots():
            self._note(robot, BONDS, bonds)
            self._handed_on[robot] = bonds

    def drain(self) -> None:
        """Hand all that came on; what is unusable is counted under the robot's name."""
        for robot in list(self._batches):
            while self._trusted(robot) and (batch := self._next_batch(robot)) is not None:
                self._try(robot, VIEWS, self._elastic.take_views, batch)
        for robot in list(self._handed_on):
            if self._trusted(robot):
                self._try(robot, BONDS, self._elastic.take_bonds, self._handed_on.pop(robot))
        for robot in self._hearer.robots():
            bonds = self._next_bonds(robot) if self._trusted(robot) else None
            if bonds is not None:
                self._try(robot, BONDS, self._elastic.take_bonds, bonds)

    def _next_batch(self, robot: str) -> bytes | None:
        """Take the first batch of a robot that waits; None where there is none any more."""
        with self._lock:
            waiting = self._batches.get(robot)
            if waiting:
                return waiting.popleft()
            self._batches.pop(robot, None)
            return None

    def _next_bonds(self, robot: str) -> bytes | None:
        """Take the bonds of a robot's present session; of one that is heard no more, the last."""
        with self._lock:
            heard = self._heard.get(robot)
            bonds = self._hearer.take(robot, heard.session if heard else '')
            if heard is None:
                self._hearer.forget(robot)
            return bonds

    def _note(self, robot: str, channel: str, data: bytes) -> None:
        """Count a message."""
        if robot in self._heard:
            self._heard[robot].hear(channel, len(data), self._clock())

    def _trusted(self, robot: str) -> bool:
        """Return whether one robot only uses a name."""
        heard = self._heard.get(robot)
        return heard is None or self._clock() >= heard.taken_until

    def _try(self, robot: str, channel: str, take: Callable[[str, bytes], bool | None], data: bytes
             ) -> None:
        """Hand one message on."""
        try:
            if take(robot, data):
                self._count(f'slam_of_{robot}_restarted', 'it goes on with the map that it had')
        except ValueError as error:
            self._count(f'{channel}_of_{robot}_unusable', str(error))
