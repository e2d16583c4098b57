# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bonds as bytes and back: the matches between two robots' views that one of them found.

Of every pair the robot whose name sorts first tells the bond, so that each match counts once. A
message holds all bonds that the robot tells now; what is missing in it no longer holds.
"""

from collections.abc import Sequence
import json
import struct
from typing import NamedTuple

import numpy as np
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.compact import (pack, pack_covariance, pack_scaled, STEP, unpack,
                                        unpack_covariance, unpack_scaled)
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_facts import believed, MAX_VIEWS, UPPER

VERSION = 2
MOST_BONDS, MOST_MATCHES = 64, 256
FARTHEST = 1000      # [m] of one view from the other
SIZE = struct.Struct('<I')


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
    """Pack bonds: some 24 bytes per match."""
    head = json.dumps({'version': VERSION, 'bonds': [
        [bond.target, bond.source, *map(str, bond.epochs), len(bond.matches)]
        for bond in bonds]}).encode()
    matches = [pack((m.target_view, m.source_view)) + pack_scaled(m.z, STEP)
               + pack_covariance(m.R) for bond in bonds for m in bond.matches]
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
    if len({row[1] for row in rows}) < len(rows):
        raise ValueError(f'{author} tells two bonds with one robot')
    rest, bonds = data[SIZE.size + size:], []
    for a, b, first, second, count in rows:
        found = []
        for _ in range(count):
            match, rest = _match(a, b, rest)
            found.append(match)
        bonds.append(ToldBond(a, b, (first, second), tuple(found)))
    if rest:
        raise ValueError('bonds are too long')
    return bonds


def _match(target: str, source: str, data: bytes) -> tuple[InterMatch, bytes]:
    """Unpack a match; return it and what follows. ValueError where it is absurd."""
    (i, j), rest = unpack(data, 2)
    z, rest = unpack_scaled(rest, STEP)
    R, rest = unpack_covariance(rest)
    if not (0 <= min(i, j) <= max(i, j) < MAX_VIEWS and np.abs(z).max() < FARTHEST):
        raise ValueError('a match is absurd')
    return InterMatch(target, i, source, j, z, believed(R[UPPER])), rest
