# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What came of work before, so that a campaign need not do the same work again.

Only of work whose result depends on nothing but its key: with the memory or without, a run is the
same to the last bit.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cache
import hashlib
from pathlib import Path
import pickle
from typing import Any
from weakref import WeakKeyDictionary

import somfusion_ros
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.team.bond_codec import ToldBond
from somfusion_ros.team.fact import Fact
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.view_facts import ViewFact
from somfusion_ros.team.view_set import DrawnScan, ViewSet
from somfusion_ros.whole_files import write_files

BATCHES = 2000   # of facts that are kept apart
ROOMS = 'fusion', 'slam', 'team'    # whose code decides what comes of a piece of work


class Memory:
    """Results by key, as many as fit; the oldest go first."""

    def __init__(self, most: int) -> None:
        self.known: dict[Hashable, Any] = {}
        self.asked = self.done = 0
        self._most = most
        self._on_disk: set[Hashable] = set()     # what was saved or loaded, and
        self._loaded: set[Path] = set()          # from where

    def of(self, key: Hashable, work: Callable[[], Any]) -> Any:
        """Return what came of a piece of work before, or do it."""
        self.asked += 1
        if key not in self.known:
            self.done += 1
            while len(self.known) >= self._most:
                del self.known[next(iter(self.known))]
            self.known[key] = work()
        return self.known[key]

    def save(self, path: Path) -> None:
        """Keep the results that are on disk nowhere yet, for a process of the same code."""
        new = {key: found for key, found in self.known.items() if key not in self._on_disk}
        write_files({path: pickle.dumps((code_digest(), new))})
        self._on_disk = {*self.known}      # of what was dropped meanwhile nothing is kept
        self._loaded.add(path)

    def load(self, path: Path) -> None:
        """Add the results of another process, if it ran the same code, once."""
        if path in self._loaded:
            return
        self._loaded.add(path)
        code, known = pickle.loads(path.read_bytes())
        if code == code_digest():
            self.known |= known
            self._on_disk |= known.keys()


@cache
def code_digest() -> str:
    """Return a word that no other version of what maps are made and matched with has."""
    root = Path(somfusion_ros.__file__).parent
    found = hashlib.sha256()
    for path in sorted(path for kind in ('py', 'json') for path in (
            *root.glob(f'*.{kind}'), *(one for room in ROOMS
                                       for one in (root / room).rglob(f'*.{kind}')))):
        found.update(path.read_bytes())
    return found.hexdigest()


class RememberingReader(FactReader):
    """Unpacks each fact once for all robots that hear it."""

    def __init__(self, most: int) -> None:
        self._memory, self._batches = Memory(most), Memory(BATCHES)
        self._first: WeakKeyDictionary[ViewSet, ViewSet] = WeakKeyDictionary()

    def facts(self, packed: bytes) -> list[Fact]:
        """Take a batch apart into its facts."""
        facts: list[Fact] = self._batches.of(packed, lambda: super(
            RememberingReader, self).facts(packed))
        return facts

    def view(self, fact: Fact) -> ViewFact:
        """Unpack a view."""
        view: ViewFact = self._memory.of(('view', fact), lambda: super(
            RememberingReader, self).view(fact))
        return view

    def cloud(self, beams: Sequence[int], outline: bytes) -> Cloud:
        """Unpack the beams of a view."""
        cloud: Cloud = self._memory.of(('cloud', tuple(beams), outline), lambda: super(
            RememberingReader, self).cloud(beams, outline))
        return cloud

    def loop(self, fact: Fact) -> Constraint:
        """Unpack a constraint between two views."""
        loop: Constraint = self._memory.of(('loop', fact), lambda: super(
            RememberingReader, self).loop(fact))
        return loop

    def scan(self, fact: Fact) -> DrawnScan:
        """Unpack a scan that is only drawn."""
        scan: DrawnScan = self._memory.of(('scan', fact), lambda: super(
            RememberingReader, self).scan(fact))
        return scan

    def bonds(self, data: bytes, author: str) -> list[ToldBond]:
        """Unpack the bonds that an author tells."""
        bonds: list[ToldBond] = self._memory.of(('bonds', data, author), lambda: super(
            RememberingReader, self).bonds(data, author))
        return bonds

    def settled(self, views: ViewSet) -> ViewSet:
        """
        Return views where their own constraints have them.

        New ones every time: who compares them by identity is to find what it would without memory.
        """
        parts = *views.clouds, *views.steps, *views.loops, *views.between
        key = views.stamps.tobytes(), views.poses.tobytes(), tuple(map(id, parts))
        _, settled = self._memory.of(('settled', *key), lambda: (views, super(
            RememberingReader, self).settled(views)))     # what is kept keeps its identity
        copy: ViewSet = replace(settled)
        self._first[copy] = settled
        return copy

    def first_of(self, views: ViewSet) -> ViewSet:
        """Return the first views of which some are a copy."""
        return self._first.get(views, views)
