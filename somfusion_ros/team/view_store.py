# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Facts on the way: batches of them as bytes, and what a robot keeps of those it heard.

A batch names the epoch of the map and the telling: a program that is started again tells all anew.
Batches come in order, some twice; views have numbers, and other facts are what they say, so that a
fact that comes again changes nothing.
"""

from collections.abc import Iterator, Sequence
import struct

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.checkpoint import NOTHING
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.team.fact import (Fact, LOOP, MOST_CORNERS, pack_facts, SCAN, TAKEN_BACK,
                                     VIEW)
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.view_facts import decode_taken_back, Facts, ViewFact
from somfusion_ros.team.view_set import DrawnScan, ViewSet

VERSION = 3
HEAD = struct.Struct('<BBB')      # version, letters of the epoch and of the telling
MOST_BYTES = 40_000_000           # of one robot's facts in memory: twenty kilometres of driving
MOST_BEAMS = 10_000_000           # of one robot's facts once unpacked: two gigabytes at most
LARGEST_BATCH = 4_000_000         # [bytes]
FEW = {LOOP: 256, SCAN: 1024}     # facts that a robot may tell of its path, and so many
EACH = {LOOP: 16, SCAN: 64}       # more per view: a robot that turns on the spot tells 32 scans
IN_ONE = 256                      # facts of one message, of the robot's own
AT_A_TIME = 10                    # facts that are new after a map interval, about


def encode_batches(epoch: Epoch, telling: str, facts: Facts) -> list[bytes]:
    """Pack facts of one epoch into messages, of which none is too large."""
    words = str(epoch).encode(), telling.encode()
    head = b''.join([HEAD.pack(VERSION, *map(len, words)), *words])
    return [head + pack_facts(part) for part in _parts(facts.every)]


def told_bytes(facts: Facts) -> int:
    """Return how many bytes a robot tells that packs some facts at a time, as it drives."""
    every = facts.every
    return sum(len(pack_facts(every[k:k + AT_A_TIME])) for k in range(0, len(every), AT_A_TIME))


def _parts(facts: Sequence[Fact]) -> Iterator[Sequence[Fact]]:
    """Yield facts in order, a message of them at a time."""
    first = corners = 0
    for k, fact in enumerate(facts):
        corners += len(fact.outline) // 4
        if k - first >= IN_ONE or corners > MOST_CORNERS:
            yield facts[first:k]
            first, corners = k, len(fact.outline) // 4
    if first < len(facts):
        yield facts[first:]


def decode_batch(data: bytes, reader: FactReader = FactReader()
                 ) -> tuple[Epoch, str, list[Fact]]:
    """Unpack epoch, telling and facts; ValueError where a batch is damaged."""
    epoch, telling, at = heading(data)
    return epoch, telling, reader.facts(data[at:])


def heading(data: bytes) -> tuple[Epoch, str, int]:
    """Return epoch and telling of a batch, and where its facts begin; ValueError if damaged."""
    if not HEAD.size <= len(data) <= LARGEST_BATCH:
        raise ValueError(f'a batch of views has {len(data)} bytes')
    version, first, second = HEAD.unpack_from(data)
    if version != VERSION:
        raise ValueError(f'a batch of views is of version {version}, not {VERSION}')
    at = HEAD.size + first + second
    try:
        epoch = Epoch.parse(data[HEAD.size:HEAD.size + first].decode('ascii'))
        telling = data[HEAD.size + first:at].decode('ascii')
    except UnicodeDecodeError as error:
        raise ValueError('a batch of views names no epoch') from error
    return epoch, telling, at


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
        self._stamps: list[float] = []
        self._poses: list[Array] = []
        self._clouds: list[Cloud] = []
        self._steps: list[Constraint] = []
        self._loops: dict[Fact, Constraint] = {}
        self._scans: dict[Fact, DrawnScan] = {}
        self._taken_back: set[int] = set()
        self._views: ViewSet | None = None
        self.bytes, self.batches, self._kept, self._beams = 0, [], 0, 0

    def take(self, data: bytes) -> bool:
        """
        Add a batch; ValueError, once its good facts are in, where one of them is unusable.

        Return whether it is the first of a program that goes on with the map of another one.
        """
        epoch, telling, facts = decode_batch(data, self._reader)
        restarted = epoch == self.epoch and telling != self._telling
        if (epoch, telling) != (self.epoch, self._telling):
            self._clear()
            self.epoch, self._telling = epoch, telling
        wrong, before = '', self.bytes
        for fact in facts:
            if self._full(fact.kind):
                wrong = f'over {self._most(fact.kind)} facts of one kind for {self._count} views'
                break
            try:
                self._add(fact)
            except ValueError as error:
                wrong = str(error)
        if self.bytes > before:
            self._views = None
            if self._kept + len(data) <= MOST_BYTES:
                self.batches.append(data)
                self._kept += len(data)
        if wrong:
            raise ValueError(wrong)
        return restarted

    @property
    def _count(self) -> int:
        """Views that came."""
        return len(self._poses) + len(self._waiting)

    def _most(self, kind: int) -> int:
        """Return how many facts of a kind so many views may have."""
        few, each = FEW[kind], EACH[kind]
        return few + each * self._count

    def _full(self, kind: int) -> bool:
        """Return whether there are as many facts of a kind as there may be."""
        held = {LOOP: len(self._loops), SCAN: len(self._scans)}.get(kind, 0)
        return bool(held) and held >= self._most(kind)

    def _add(self, fact: Fact) -> None:
        """Add a fact that is new."""
        if fact in self._loops or fact in self._scans:
            return
        if self.bytes + fact.size > MOST_BYTES:
            raise ValueError(f'the views of one robot are over {MOST_BYTES} bytes')
        if self._beams + fact.beams > MOST_BEAMS:
            raise ValueError(f'the views of one robot are over {MOST_BEAMS} beams')
        if fact.kind == VIEW:
            view = self._reader.view(fact)
            if view.number < len(self._poses) or view.number in self._waiting:
                return
            self._waiting[view.number] = view
        elif fact.kind == LOOP:
            self._loops[fact] = self._reader.loop(fact)
        elif fact.kind == SCAN:
            self._scans[fact] = self._reader.scan(fact)
        elif fact.kind == TAKEN_BACK:
            views = decode_taken_back(fact)
            if self._taken_back.issuperset(views):
                return
            self._taken_back.update(views)
        else:
            raise ValueError(f'a fact of the kind {fact.kind} is none of a path')
        self.bytes += fact.size
        self._beams += fact.beams
        while len(self._poses) in self._waiting:
            view = self._waiting.pop(len(self._poses))
            self._clouds.append(self._reader.cloud(view.beams, view.outline))
            self._poses.append(view.pose_after(self._poses))
            self._stamps.append(view.stamp)
            self._steps += [view.step] if view.step else []

    def views(self) -> ViewSet:
        """
        Return the views of the path as far as they are one path; always the same if so.

        They lie where all that the robot has told of them puts them.
        """
        if self._views is None:
            n = len(self._poses)
            self._views = self._reader.settled(ViewSet(
                np.array(self._stamps), np.array(self._poses).reshape(-1, 3),
                [NOTHING if k in self._taken_back else cloud
                 for k, cloud in enumerate(self._clouds)],
                list(self._steps),
                [c for fact, c in sorted(self._loops.items()) if max(c.first, c.second) < n],
                [scan for fact, scan in sorted(self._scans.items())
                 if scan.view < n and scan.view not in self._taken_back]))
        return self._views
