# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bonds on the way: a robot replaces all that it told before, so that what is older must be known.

A message names the session, which is new with every start, and a number that grows in it.
"""

from collections import deque
import struct
from typing import NamedTuple

VERSION = 1
HEAD = struct.Struct('<BBI')      # version, letters of the session, number
MOST_LETTERS = 32                 # of a session
SESSIONS_KEPT = 8                 # of a robot


class BondMessage(NamedTuple):
    """Packed bonds (bond_codec), and what tells them from those that were told before."""

    session: str
    number: int
    bonds: bytes

    def encode(self) -> bytes:
        """Pack the message."""
        session = self.session.encode('ascii')
        return HEAD.pack(VERSION, len(session), self.number) + session + self.bonds

    @classmethod
    def decode(cls, data: bytes) -> 'BondMessage':
        """Unpack a message; ValueError where its head is damaged."""
        if len(data) < HEAD.size:
            raise ValueError(f'a message of bonds has {len(data)} bytes')
        version, letters, number = HEAD.unpack_from(data)
        at = HEAD.size + letters
        if version != VERSION or not 0 < letters <= MOST_LETTERS or at > len(data):
            raise ValueError(f'a message of bonds is of version {version}, not {VERSION}, or has '
                             'no session')
        try:
            return cls(data[HEAD.size:at].decode('ascii'), number, data[at:])
        except UnicodeDecodeError as error:
            raise ValueError('a message of bonds names no session') from error


class BondTeller:
    """Tells the bonds of one robot where they changed, from its start on."""

    def __init__(self, session: str) -> None:
        self._session, self._number = session, 0
        self._said = b''      # that there are none is told, too: others know those of before

    def more(self, bonds: bytes) -> bytes | None:
        """Return the message that tells packed bonds; None where they were told."""
        if bonds == self._said:
            return None
        self._said = bonds
        self._number += 1
        return BondMessage(self._session, self._number, bonds).encode()


class BondHearer:
    """Knows which of a robot's messages are newer than all that came before."""

    def __init__(self) -> None:
        self._sessions: dict[str, deque[str]] = {}
        self._numbers: dict[str, int] = {}

    def newer(self, robot: str, message: BondMessage) -> bool:
        """Return whether a message begins a new session, or is newer than those of the present."""
        sessions = self._sessions.setdefault(robot, deque(maxlen=SESSIONS_KEPT))
        if message.session in sessions and (
                message.session != sessions[-1] or message.number <= self._numbers[robot]):
            return False
        if message.session not in sessions:
            sessions.append(message.session)
        self._numbers[robot] = message.number
        return True
