# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bonds as bytes and back: the matches between two robots' views that one of them found.

Of every pair the robot whose name sorts first tells the bond, so that each match counts once. A
message holds all bonds that the robot tells now; what is missing in it no longer holds.
"""

from collections.abc import Iterable, Sequence
import json
import struct
from typing import NamedTuple

import numpy as np
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_facts import believed, MAX_VIEWS, UPPER

VERSION = 1
MOST_BONDS, MOST_MATCHES = 64, 256
SIZE = struct.Struct('<I')
MATCH = struct.Struct('<II9f')   # views of target and source, z, upper triangle of R


class ToldBond(NamedTuple):
    """The matches of a pair, and the epochs of the maps that they join."""

    target: str
    source: str
    epochs: tuple[Epoch, Epoch]
    matches: tuple[InterMatch, ...]


def told(bond: Bond, epochs: tuple[Epoch, Epoch]) -> ToldBond:
    """Return what is told of a bond that holds."""
    return ToldBond(bond.target, bond.source, epochs, bond.matches[:MOST_MATCHES])


def encode_bonds(bonds: Sequence[ToldBond]) -> bytes:
    """Pack bonds: 44 bytes per match."""
    head = json.dumps({'version': VERSION, 'bonds': [
        [bond.target, bond.source, *map(str, bond.epochs), len(bond.matches)]
        for bond in bonds]}).encode()
    matches = [MATCH.pack(m.target_view, m.source_view, *m.z, *m.R[UPPER])
               for bond in bonds for m in bond.matches]
    return b''.join([SIZE.pack(len(head)), head, *matches])


def decode_bonds(data: bytes, author: str) -> list[ToldBond]:
    """Unpack the bonds that an author tells; ValueError, with one line, on anything else."""
    try:
        size, = SIZE.unpack_from(data)
        head = json.loads(data[SIZE.size:SIZE.size + size].decode('ascii'))
        if head['version'] != VERSION:
            raise ValueError(f'bonds of version {str(head["version"])[:20]}')
        rows = [(str(a), str(b), Epoch.parse(first), Epoch.parse(second), int(count))
                for a, b, first, second, count in head['bonds']]
    except (struct.error, KeyError, TypeError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f'not bonds: {error!r}') from error
    if len(rows) > MOST_BONDS or any(not 0 <= row[-1] <= MOST_MATCHES for row in rows):
        raise ValueError('too many bonds or matches')
    if any(row[0] != author or row[0] >= row[1] for row in rows):
        raise ValueError(f'{author} tells a bond that is not its own')
    body = data[SIZE.size + size:]
    if len(body) != MATCH.size * sum(row[-1] for row in rows):
        raise ValueError('bonds are cut short')
    matches, bonds = iter(MATCH.iter_unpack(body)), []
    for a, b, first, second, count in rows:
        found = tuple(_match(a, b, next(matches)) for _ in range(count))
        bonds.append(ToldBond(a, b, (first, second), found))
    return bonds


def _match(target: str, source: str, numbers: Iterable[float]) -> InterMatch:
    """Make a match of its numbers; ValueError where they are absurd."""
    i, j, *rest = numbers
    if max(i, j) >= MAX_VIEWS or not np.isfinite(rest).all():
        raise ValueError('a match is not finite')
    return InterMatch(target, int(i), source, int(j), np.array(rest[:3]),
                      believed(np.array(rest[3:])))
