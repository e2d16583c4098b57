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
        self._newest: dict[str, tuple[str, int]] = {}

    def newer(self, robot: str, message: BondMessage) -> bool:
        """Return whether a message is the first of its session, or newer than those of it."""
        session, number = self._newest.get(robot, ('', 0))
        if message.session == session and message.number <= number:
            return False
        self._newest[robot] = message.session, message.number
        return True
