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
from somfusion_ros.team.compact import (covariance_from, covariance_numbers, from_steps, in_steps,
                                        STEP)
from somfusion_ros.team.fact import Fact, MATCH, pack_facts, unpack_facts
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_facts import believed, MAX_VIEWS, UPPER

VERSION = 3
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
    """Pack bonds: some 15 bytes per match."""
    head = json.dumps({'version': VERSION, 'bonds': [
        [bond.target, bond.source, *map(str, bond.epochs), len(bond.matches)]
        for bond in bonds]}).encode()
    matches = [Fact(MATCH, (m.target_view, m.source_view, *in_steps(m.z, STEP),
                            *covariance_numbers(m.R))) for bond in bonds for m in bond.matches]
    return SIZE.pack(len(head)) + head + pack_facts(matches)


def decode_bonds(data: bytes, author: str) -> list[ToldBond]:
    """Unpack the bonds that an author tells; ValueError, with one line, on anything else."""
    try:
        size, = SIZE.unpack_from(data)
        head = json.loads(data[SIZE.size:SIZE.size + size].decode('ascii'))
        if head['version'] != VERSION:
            raise ValueError(f'bonds of version {str(head["version"])[:20]}')
        rows = [(str(a), str(b), Epoch.parse(first), Epoch.parse(second), int(count))
                for a, b, first, second, count in head['bonds']]
    except (struct.error, KeyError, TypeError, OverflowError, RecursionError,
            UnicodeDecodeError) as error:
        raise ValueError(f'not bonds: {error!r}') from error
    if len(rows) > MOST_BONDS or any(not 0 <= row[-1] <= MOST_MATCHES for row in rows):
        raise ValueError('too many bonds or matches')
    if any(row[0] != author or row[0] >= row[1] for row in rows):
        raise ValueError(f'{author} tells a bond that is not its own')
    if len({row[1] for row in rows}) < len(rows):
        raise ValueError(f'{author} tells two bonds with one robot')
    facts, at = unpack_facts(data[SIZE.size + size:]), 0
    if len(facts) != sum(row[-1] for row in rows) or any(fact.kind != MATCH for fact in facts):
        raise ValueError('bonds do not have the matches that they name')
    bonds = []
    for a, b, first, second, count in rows:
        matches = tuple(_match(a, b, fact.numbers) for fact in facts[at:at + count])
        bonds.append(ToldBond(a, b, (first, second), matches))
        at += count
    return bonds


def _match(target: str, source: str, numbers: Sequence[int]) -> InterMatch:
    """Return a match; ValueError where it is absurd."""
    i, j, *rest = numbers
    z, R = from_steps(rest[:3], STEP), covariance_from(rest[3:])
    if not (0 <= min(i, j) <= max(i, j) < MAX_VIEWS and np.abs(z).max() < FARTHEST):
        raise ValueError('a match is absurd')
    return InterMatch(target, i, source, j, z, believed(R[UPPER]))
