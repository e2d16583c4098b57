# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One thing that a robot tells of its path, as whole numbers, and many of them as bytes."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.team.bit_code import (bytes_for, deflate, inflate, lengths, pack_bits,
                                         unpack_bits, zagzig, zigzag)
from somfusion_ros.team.compact import pack, unpack
from somfusion_ros.team.outline_code import Corners

VIEW, LOOP, SCAN, TAKEN_BACK, MATCH = 1, 2, 3, 4, 5
WIDTH = {VIEW: 22, LOOP: 11, SCAN: 12, TAKEN_BACK: 2, MATCH: 11}     # numbers of a fact
LIKE_THE_LAST = {VIEW: (0, 1, *range(9, 22)), LOOP: (0, *range(5, 11)),
                 SCAN: (0, 1, *range(5, 12)), TAKEN_BACK: (),
                 MATCH: (0, 1, *range(5, 11))}    # numbers that change little
BEAMS_AT = {VIEW: 15, SCAN: 5}     # which number says of how many beams a fact is
MOST_FACTS = 16384        # of a message
MOST_CORNERS = 1 << 17
GAP = 17                  # lengths of a value per length of a gap, in the symbol of a corner


class Fact(NamedTuple):
    """Whole numbers, what they mean by kind, and the corners of what was seen, as bytes."""

    kind: int
    numbers: tuple[int, ...]
    outline: bytes = b''

    @property
    def size(self) -> int:
        """Bytes that it takes in memory, about."""
        return 8 * len(self.numbers) + len(self.outline)

    @property
    def beams(self) -> int:
        """Beams that it makes once it is unpacked, however few bytes tell of them."""
        at = BEAMS_AT.get(self.kind)
        return 0 if at is None else max(0, self.numbers[at])


def corners_in(outline: bytes) -> Corners:
    """Return corners of their bytes."""
    gaps, values = np.frombuffer(outline, np.uint16).reshape(-1, 2).T
    return Corners(gaps, values)


def outline_of(corners: Corners) -> bytes:
    """Return the bytes of corners."""
    return np.column_stack(corners).astype(np.uint16).tobytes()


def pack_facts(facts: Sequence[Fact]) -> bytes:
    """
    Pack facts, those of one kind beside one another.

    Most numbers are told as what changed since the fact before. Then come the lengths of all
    numbers in bits, deflated together, and their bits.
    """
    groups = [(kind, list(group)) for kind, group in groupby(facts, lambda fact: fact.kind)]
    values = [zigzag(_rows(kind, group)).ravel() for kind, group in groups]
    counts = [np.array([len(fact.outline) // 4 for fact in facts], np.uint64)]
    plain = np.concatenate([*counts, *values])
    corners = np.frombuffer(b''.join(fact.outline for fact in facts),
                            np.uint16).reshape(-1, 2).astype(np.uint64)
    symbols = GAP * lengths(corners[:, 0]) + lengths(corners[:, 1])
    head = pack([len(groups), *(n for kind, group in groups for n in (kind, len(group))),
                 len(corners)])
    return (head + deflate(lengths(plain).tobytes() + symbols.astype(np.uint8).tobytes())
            + pack_bits(np.concatenate([plain, corners.ravel()])))


def _rows(kind: int, facts: Iterable[Fact]) -> NDArray[np.int64]:
    """Return the numbers of facts of a kind (n, width), those that change little as changes."""
    rows = np.array([fact.numbers for fact in facts], np.int64).reshape(-1, WIDTH[kind])
    like = list(LIKE_THE_LAST[kind])
    rows[1:, like] -= rows[:-1, like].copy()
    return rows


def unpack_facts(data: bytes) -> list[Fact]:
    """Unpack facts; ValueError, with one line, where they are damaged or too many."""
    (count,), rest = unpack(data, 1)
    if not 0 <= count <= MOST_FACTS:
        raise ValueError(f'a message of views has {count} groups')
    head, rest = unpack(rest, 2 * count + 1)
    groups, corners = list(zip(head[:-1:2], head[1:-1:2], strict=True)), head[-1]
    if not (all(kind in WIDTH and 0 < size <= MOST_FACTS for kind, size in groups)
            and sum(size for _, size in groups) <= MOST_FACTS
            and 0 <= corners <= MOST_CORNERS):
        raise ValueError('a message of views has unknown, too many or no facts')
    facts = sum(size for _, size in groups)
    plain = facts + sum(WIDTH[kind] * size for kind, size in groups)
    symbols, rest = inflate(rest, plain + corners)
    count_of = np.concatenate([symbols[:plain], np.column_stack([
        symbols[plain:] // GAP, symbols[plain:] % GAP]).ravel()])
    if count_of[:plain].max(initial=0) > 62 or len(rest) != bytes_for(count_of):
        raise ValueError('a message of views is damaged (its bits do not fit its numbers)')
    numbers = unpack_bits(rest, count_of)
    ends = np.cumsum(numbers[:facts].astype(np.int64))
    if facts and (ends[-1] != corners or numbers[:facts].max() > MOST_CORNERS):
        raise ValueError('a message of views is damaged (its corners do not fit its facts)')
    outlines = numbers[plain:].reshape(-1, 2).astype(np.uint16)
    return list(_facts(groups, zagzig(numbers[facts:plain]), np.split(outlines, ends[:-1])))


def _facts(groups: Sequence[tuple[int, int]], numbers: NDArray[np.int64],
           outlines: Sequence[NDArray[np.uint16]]) -> Iterator[Fact]:
    """Put facts together, by group."""
    at = seen = 0
    for kind, size in groups:
        rows = numbers[at:at + WIDTH[kind] * size].reshape(size, -1).copy()
        like = list(LIKE_THE_LAST[kind])
        rows[:, like] = np.cumsum(rows[:, like], axis=0)
        at += rows.size
        for row in rows.tolist():
            yield Fact(kind, tuple(row), outlines[seen].tobytes())
            seen += 1
