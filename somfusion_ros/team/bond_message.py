# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bonds on the way: a robot replaces all that it told before, so that what is older must be known.

A message names the session, which is new with every start, and a number that grows in it.
"""

import struct
from typing import NamedTuple

VERSION = 1
HEAD = struct.Struct('<BBI')      # version, letters of the session, number
MOST_LETTERS = 32                 # of a session
SESSIONS_KEPT = 8                 # of a robot
GONE_KEPT = 64                    # robots that told bonds and are heard no more
LARGEST = 1 << 20                 # bytes of a message; 64 bonds of 256 matches take a quarter


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
        if not HEAD.size <= len(data) <= LARGEST:
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
    """
    Keeps the newest message of each of a robot's last sessions.

    Which of them counts its state says: a session may come back, after another robot had spoken
    under the name for a while, and a message may be late, of one that ended.
    """

    def __init__(self) -> None:
        self._newest: dict[str, dict[str, BondMessage]] = {}
        self._taken: dict[str, BondMessage] = {}

    def keep(self, robot: str, message: BondMessage) -> None:
        """Keep a message, unless a newer one of its session came before."""
        sessions = self._newest.setdefault(robot, {})
        before = sessions.get(message.session)
        if before is None or message.number > before.number:
            sessions[message.session] = message
        for ended in list(sessions)[:-SESSIONS_KEPT]:
            sessions.pop(ended, None)

    def take(self, robot: str, session: str) -> bytes | None:
        """Return the bonds of a session, of the last that began if it is ''; None if taken."""
        sessions = self._newest.get(robot, {})
        message = sessions.get(session or ''.join(list(sessions)[-1:]))
        if message is None or message is self._taken.get(robot):
            return None
        self._taken[robot] = message
        return message.bonds

    def forget(self, robot: str) -> None:
        """Keep of a robot only that it told bonds itself, and that only of the last that went."""
        if not self._newest.get(robot, True):
            return
        self._newest.pop(robot, None)
        self._newest[robot] = {}
        self._taken.pop(robot, None)
        gone = [name for name, sessions in self._newest.items() if not sessions]
        for name in gone[:-GONE_KEPT]:
            del self._newest[name]

    def robots(self) -> list[str]:
        """Return the robots of which a message came."""
        return list(self._newest)
