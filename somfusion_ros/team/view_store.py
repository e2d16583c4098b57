# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Facts on the way: batches of them as bytes, and what a robot keeps of those it heard.

A batch names the epoch of the map and the telling: a program that is started again tells all anew.
Batches come in order, some twice; facts have numbers or are their own bytes, so a fact that comes
again changes nothing.
"""

from dataclasses import replace
import struct

import numpy as np
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.loop_closer import NOTHING
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.view_facts import decode_taken_back, Facts, ViewFact
from somfusion_ros.team.view_set import DrawnScan, ViewSet

VERSION = 2
VIEW, LOOP, SCAN, TAKEN_BACK = 1, 2, 3, 4
HEAD = struct.Struct('<BBB')      # version, letters of the epoch and of the telling
FACT = struct.Struct('<BH')       # kind, bytes
MOST_BYTES = 40_000_000           # of one robot's facts: ten kilometres of driving
LARGEST_BATCH = 4_000_000         # [bytes]
FEW = {LOOP: 256, SCAN: 1024}     # facts that a robot may tell of its path, and so many
EACH = {LOOP: 16, SCAN: 64}       # more per view: a robot that turns on the spot tells 32 scans


def encode_batch(epoch: Epoch, telling: str, facts: Facts) -> bytes:
    """Pack facts of one epoch."""
    words = str(epoch).encode(), telling.encode()
    parts = [HEAD.pack(VERSION, *map(len, words)), *words]
    for kind, group in ((VIEW, facts.views), (LOOP, facts.loops), (SCAN, facts.between),
                        (TAKEN_BACK, facts.taken_back)):
        for fact in group:
            parts += [FACT.pack(kind, len(fact)), fact]
    return b''.join(parts)


def decode_batch(data: bytes) -> tuple[Epoch, str, list[tuple[int, bytes]]]:
    """Unpack epoch, telling and facts by kind; ValueError where a batch is damaged."""
    if not HEAD.size <= len(data) <= LARGEST_BATCH:
        raise ValueError(f'a batch of views has {len(data)} bytes')
    version, first, second = HEAD.unpack_from(data)
    if version != VERSION:
        raise ValueError(f'a batch of views is of version {version}')
    at = HEAD.size + first + second
    try:
        epoch = Epoch.parse(data[HEAD.size:HEAD.size + first].decode('ascii'))
        telling = data[HEAD.size + first:at].decode('ascii')
    except UnicodeDecodeError as error:
        raise ValueError('a batch of views names no epoch') from error
    facts = []
    while at < len(data):
        if at + FACT.size > len(data):
            raise ValueError('a batch of views is cut short')
        kind, size = FACT.unpack_from(data, at)
        at += FACT.size + size
        if at > len(data):
            raise ValueError('a batch of views is cut short')
        facts.append((kind, data[at - size:at]))
    return epoch, telling, facts


class ViewStore:
    """What one robot has told of its path, in the epoch that it spoke of last."""

    def __init__(self, reader: FactReader = FactReader()) -> None:
        self._reader = reader
        self.epoch: Epoch | None = None
        self.bytes = 0
        self.batches: list[bytes] = []     # as they came, for those who come later
        self._telling = ''
        self._clear()

    def _clear(self) -> None:
        self._waiting: dict[int, ViewFact] = {}
        self._chain: list[ViewFact] = []
        self._clouds: list[Cloud] = []
        self._loops: dict[bytes, Constraint] = {}
        self._scans: dict[bytes, DrawnScan] = {}
        self._taken_back: set[int] = set()
        self._views: ViewSet | None = None
        self.bytes, self.batches, self._kept = 0, [], 0

    def take(self, data: bytes) -> None:
        """Add a batch; ValueError, once its good facts are in, where one of them is unusable."""
        epoch, telling, facts = decode_batch(data)
        if (epoch, telling) != (self.epoch, self._telling):
            self._clear()
            self.epoch, self._telling = epoch, telling
        wrong, before = '', self.bytes
        for kind, fact in facts:
            if self._full(kind):
                wrong = f'over {self._most(kind)} facts of one kind for {self._count} views'
                break
            try:
                self._add(kind, fact)
            except ValueError as error:
                wrong = str(error)
        if self.bytes > before:
            self._views = None
            if self._kept + len(data) <= MOST_BYTES:
                self.batches.append(data)
                self._kept += len(data)
        if wrong:
            raise ValueError(wrong)

    @property
    def _count(self) -> int:
        """Views that came."""
        return len(self._chain) + len(self._waiting)

    def _most(self, kind: int) -> int:
        """Return how many facts of a kind so many views may have."""
        few, each = FEW[kind], EACH[kind]
        return few + each * self._count

    def _full(self, kind: int) -> bool:
        """Return whether there are as many facts of a kind as there may be."""
        held = {LOOP: len(self._loops), SCAN: len(self._scans)}.get(kind, 0)
        return bool(held) and held >= self._most(kind)

    def _add(self, kind: int, fact: bytes) -> None:
        """Add a fact that is new."""
        if fact in self._loops or fact in self._scans:
            return
        if self.bytes + len(fact) > MOST_BYTES:
            raise ValueError(f'the views of one robot are over {MOST_BYTES} bytes')
        if kind == VIEW:
            view = self._reader.view(fact)
            if view.number < len(self._chain) or view.number in self._waiting:
                return
            self._waiting[view.number] = view
        elif kind == LOOP:
            self._loops[fact] = self._reader.loop(fact)
        elif kind == SCAN:
            self._scans[fact] = self._reader.scan(fact)
        elif kind == TAKEN_BACK:
            self._taken_back.update(decode_taken_back(fact))
        else:
            raise ValueError(f'a fact of the unknown kind {kind}')
        self.bytes += len(fact)
        while len(self._chain) in self._waiting:
            view = self._waiting.pop(len(self._chain))
            self._clouds.append(self._reader.cloud(view.beams))
            self._chain.append(replace(view, beams=b''))

    def views(self) -> ViewSet:
        """
        Return the views of the path as far as they are one path; always the same if so.

        They lie where all that the robot has told of them puts them.
        """
        if self._views is None:
            n = len(self._chain)
            self._views = self._reader.settled(ViewSet(
                np.array([view.stamp for view in self._chain]),
                np.array([view.pose for view in self._chain]).reshape(-1, 3),
                [NOTHING if k in self._taken_back else cloud
                 for k, cloud in enumerate(self._clouds)],
                [view.step for view in self._chain if view.step],
                [c for fact, c in sorted(self._loops.items()) if max(c.first, c.second) < n],
                [scan for fact, scan in sorted(self._scans.items())
                 if scan.view < n and scan.view not in self._taken_back]))
        return self._views
