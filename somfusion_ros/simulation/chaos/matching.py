# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Matching of two maps that remembers what came of it.

A campaign replays the same few maps in ever new orders: what was matched once need not be again.
The result is that of the real matcher, to the last bit.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from hashlib import blake2b
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from somfusion_ros.fusion.alignment import align, Alignment
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.chaos.memory import Memory, RememberingReader
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.bond_codec import ToldBond
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.graph import solve
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.screening import outline, screen, Screening
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.state_codec import decode_state, TeamState
from somfusion_ros.team.view_set import ViewSet

LARGEST = 50000    # results that are remembered,
SOLUTIONS = 2000   # graphs that were solved,
FACTS = 30000      # facts that were unpacked,
STATES = 500       # states that were read,
DRAWINGS = 200     # and maps that were drawn of views


class Matching(Matchers):
    """
    The matchers of a session, with a memory that all sessions of a campaign share.

    Maps are learned without what a session kept of earlier ones: that rounds otherwise, so that
    the last bits would depend on who asked first.
    """

    def __init__(self) -> None:
        self.memory = Memory(LARGEST)
        self.reader = remembering = RememberingReader(FACTS)
        self._first_of = remembering.first_of
        self._solved, self._states = Memory(SOLUTIONS), Memory(STATES)
        self._drawn = Memory(DRAWINGS)
        self._digests: WeakKeyDictionary[ViewSet, bytes] = WeakKeyDictionary()
        self._grids: WeakKeyDictionary[Grid, bytes] = WeakKeyDictionary()
        self.sizes: Counter[str] = Counter()   # of the largest work of a kind
        self.draws = True    # views; else what is drawn of the same ones is only the same

    def align(self, target: Grid, source: Grid, config: FusionConfig,
              cache: FusionCache) -> Alignment:
        """Match two maps."""
        self._note('cells matched', max(target.evidence.size, source.evidence.size))
        found: Alignment = self.memory.of(('align', self._map(target), self._map(source)),
                                          lambda: align(target, source, config,
                                                        cache=FusionCache()))
        return replace(found, seconds={})   # how long it took is no part of a simulation

    def screen(self, own: Grid, clusters: Clusters, config: FusionConfig,
               cache: FusionCache) -> Screening:
        """Compare a map with a peer's clusters."""
        told = blake2b(np.ascontiguousarray(clusters.centres).data, digest_size=16).digest()
        found: Screening = self.memory.of(
            ('screen', self._map(own), told),
            lambda: screen(learn(own, config, FusionCache()), clusters, config))
        return found

    def clusters(self, session: FusionSession) -> Clusters:
        """Return the clusters that a robot tells of its own map."""
        own = session.own_grid
        assert own is not None      # who tells clusters has a map
        found: Clusters = self.memory.of(('clusters', self._map(own)), lambda: outline(
            learn(own, session.fusion, FusionCache())))
        return found

    def bond(self, views: Mapping[str, ViewSet], target: str, source: str, T_target_source: Pose
             ) -> Bond:
        """Ask the views of two robots about a pose; their names play no part in the answer."""
        key = 'bond', self._of(views[target]), self._of(views[source]), tuple(T_target_source)
        pair = {'a': views[target], 'b': views[source]}
        found = self.memory.of(key, lambda: super(Matching, self).bond(
            pair, 'a', 'b', T_target_source))
        return _renamed(found, target, source)

    def rival(self, bond: Bond, views: Mapping[str, ViewSet], T_target_source: Pose
              ) -> Bond | None:
        """Ask the views of a pair about another pose."""
        pair = {'a': views[bond.target], 'b': views[bond.source]}
        key = ('rival', *map(self._of, pair.values()), tuple(T_target_source), _told(bond.matches))
        found = self.memory.of(key, lambda: super(Matching, self).rival(
            _renamed(bond, 'a', 'b'), pair, T_target_source))
        return None if found is None else _renamed(found, *bond.pair)

    def join(self, views: Mapping[str, ViewSet], world: Mapping[str, Pose],
             bonds: Sequence[ToldBond], anchor: str) -> dict[str, Array]:
        """Solve a team's problem."""
        key = ('join', anchor, *((name, self._of(views[name]), *world[name])
                                 for name in sorted(views)),
               *sorted((bond.target, bond.source, _told(bond.matches)) for bond in bonds))
        found: dict[str, Array] = self.memory.of(key, lambda: super(Matching, self).join(
            views, world, bonds, anchor))
        return found

    def draw(self, views: Mapping[str, ViewSet], poses: Mapping[str, Array], resolution: float
             ) -> Grid:
        """Draw a team's views, or what is the same where they are."""
        self._note('scans drawn', sum(len(views[name]) + len(views[name].between)
                                      for name in poses))
        key = tuple((name, self._of(views[name]), poses[name].tobytes()) for name in sorted(poses))
        drawn: Grid = self._drawn.of((self.draws, key), lambda: super(Matching, self).draw(
            _apart(views), poses, resolution) if self.draws else _sign(key, resolution))
        return drawn

    def solve(self, robots: Iterable[str], constraints: Sequence[MapConstraint]) -> Solution:
        """Place every robot's map in the world of its connected group."""
        names = sorted(robots)
        self._note('constraints solved', len(constraints))
        key = tuple(names), tuple((*c.robots, c.author, c.T_target_source, c.covariance.tobytes(),
                                   c.probability, c.kind, c.epochs) for c in constraints)
        found: Solution = self._solved.of(key, lambda: solve(names, constraints))
        return found

    @property
    def asked(self) -> int:
        """Pieces of heavy work that were asked for: matches, solutions, drawings."""
        return self.memory.asked + self._solved.asked + self._drawn.asked

    def read_state(self, text: str) -> TeamState:
        """Read what a robot said, once for all that hear it."""
        state: TeamState = self._states.of(text, lambda: decode_state(text))
        return state

    def _note(self, kind: str, size: int) -> None:
        """Note how large a piece of work is."""
        self.sizes[kind] = max(self.sizes[kind], size)

    def _map(self, grid: Grid | None) -> bytes:
        """Return bytes that no other map has."""
        if grid is None:
            return b''
        if grid not in self._grids:
            self._grids[grid] = blake2b(
                np.ascontiguousarray(grid.evidence).data, digest_size=16,
                key=repr((grid.resolution, *grid.T_frame_grid)).encode()[:64]).digest()
        return self._grids[grid]

    def _of(self, views: ViewSet) -> bytes:
        """Return bytes that no other views have."""
        views = self._first_of(views)
        if views not in self._digests:
            made = blake2b(digest_size=16)
            for array in (views.stamps, views.poses,
                          *(part for c in (*views.steps, *views.loops) for part in (c.z, c.R)),
                          np.array([(c.first, c.second) for c in (*views.steps, *views.loops)]),
                          *(part for cloud in views.clouds
                            for part in (cloud.points, cloud.outline.ends)),
                          *(part for scan in views.between
                            for part in (scan.T_view_base, scan.outline.ends)),
                          np.array([(scan.stamp, scan.view) for scan in views.between])):
                made.update(np.ascontiguousarray(array).data)
                made.update(b'|')
            self._digests[views] = made.digest()
        return self._digests[views]


def _apart(views: Mapping[str, ViewSet]) -> dict[str, ViewSet]:
    """Return views of which no two robots share an outline: what is drawn is told apart by it."""
    return {name: replace(
        one, clouds=[replace(cloud, outline=copy(cloud.outline)) for cloud in one.clouds],
        between=[replace(scan, outline=copy(scan.outline)) for scan in one.between])
        for name, one in views.items()}


def _sign(key: tuple[Any, ...], resolution: float) -> Grid:
    """Return a small map that is the same only for the same views at the same poses."""
    found = blake2b(repr(key).encode(), digest_size=32).digest()
    bits = np.unpackbits(np.frombuffer(found, np.uint8)).reshape(16, 16)
    return Grid(np.where(bits, 1.0, -1.0), resolution)


def _renamed(bond: Bond, target: str, source: str) -> Bond:
    """Return a bond of two robots of other names."""
    matches = tuple(replace(m, target=target, source=source) for m in bond.matches)
    return replace(bond, target=target, source=source, matches=matches)


def _told(matches: Sequence[InterMatch]) -> bytes:
    """Return bytes that no other matches have."""
    made = blake2b(digest_size=16)
    for m in matches:
        made.update(repr((m.target_view, m.source_view)).encode())
        made.update(m.z.tobytes() + m.R.tobytes())
    return made.digest()
