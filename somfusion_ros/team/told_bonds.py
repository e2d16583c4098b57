# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The bonds that robots tell, and which of them count.

Of every pair the robot whose name sorts first tells the bond. The other one has asked its own
views, too: a bond that it calls false, as these have the maps elsewhere, counts for nobody; nor
does one of a pair that either of the two does not accept.
"""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.bond_codec import encode_bonds, told, ToldBond
from somfusion_ros.team.elastic import astray
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_set import ViewSet

MOST_AUTHORS = 192     # as many as can be heard, gone but known, and not known yet, 64 each
Epochs = Mapping[str, Epoch]
Pairs = Collection[tuple[str, str]]


class ToldBonds:
    """What all robots tell, and what the own views say of the pairs with the robot itself."""

    def __init__(self, name: str, reader: FactReader) -> None:
        self._name, self._reader = name, reader
        self._bonds: dict[str, list[ToldBond]] = {}
        self._bytes: dict[str, bytes] = {}
        self._own: dict[str, ToldBond] = {}      # with robots whose names sort later
        self._asked: dict[str, ToldBond] = {}    # with those whose names sort before, who tell
        self._apart: dict[str, tuple[Any, float]] = {}      # what was asked last, and the answer
        self._known: frozenset[str] = frozenset()           # robots of which anything is known
        self.refuted: dict[str, frozenset[str]] = {}        # whose bonds each robot calls false

    def take(self, author: str, data: bytes) -> None:
        """Replace the bonds that a robot tells; ValueError where they are unusable."""
        if data != self._bytes.get(author):     # it is repeated now and then
            self._bonds[author] = self._reader.bonds(data, author)
            self._bytes[author] = data
            strangers = [name for name in self._bonds if name not in {*self._known, self._name}]
            for name in strangers[:max(len(self._bonds) - MOST_AUTHORS, 0)]:
                self._forget(name)

    def bytes_of(self, author: str) -> bytes:
        """Return what a robot tells, packed; empty where that is nothing."""
        return self._bytes.get(author, b'')

    def _forget(self, author: str) -> None:
        """Forget the bonds of and with a robot."""
        for record in (self._bonds, self._bytes, self._own, self._asked, self._apart):
            record.pop(author, None)

    def keep(self, peer: str, bond: Bond, accepted: bool, epochs: Epochs) -> None:
        """Keep what the own views say of a pair, if it holds, and tell it if it is told here."""
        mine = self._own if bond.target == self._name else self._asked
        mine.pop(peer, None)
        if bond.holds and accepted:
            mine[peer] = told(bond, (epochs[bond.target], epochs[bond.source]))
        self.take(self._name, encode_bonds(       # as the peers will read it
            [self._own[name] for name in sorted(self._own)]))

    def refute(self, views: Mapping[str, ViewSet], T_own_peer: Mapping[str, Pose], epochs: Epochs,
               misplaced: float, mismatched: float) -> dict[str, float]:
        """
        Return of which peers the bond with this robot is false, and by how much [m]; note it.

        What robots tell that are not known any more is forgotten: names come and go. Those of
        which nothing is known yet may tell bonds before their state comes.

        views: of the connected team; T_own_peer: of the peers that this robot accepts. False is
        one that has the own views, in the median, farther than `mismatched` [m] from where they
        match, or farther than `misplaced` [m] from where the maps do if they match nowhere.
        """
        for gone in self._known - epochs.keys():
            self._forget(gone)
        self._known, found = frozenset(epochs), {}
        for peer in self._bonds.keys() & T_own_peer.keys() & views.keys():
            theirs = next((one for one in self._bonds[peer] if one.source == self._name), None)
            now = (epochs[peer], epochs[self._name])
            if theirs is None or theirs.epochs != now or not _known(theirs.matches, views):
                continue
            mine = self._asked.get(peer)
            mine = mine if mine and mine.epochs == now and _known(mine.matches, views) else None
            key = (theirs, mine, None if mine else T_own_peer[peer],
                   views[peer], views[self._name])     # which move as more is told of them
            asked = self._apart.get(peer)
            if asked is None or asked[0] != key:
                asked = self._apart[peer] = key, _between(mine, theirs, views, T_own_peer[peer])
            if asked[1] > (mismatched if mine else misplaced):
                found[peer] = asked[1]
        self.refuted = {robot: peers for robot, peers in self.refuted.items() if robot in epochs}
        self.refuted[self._name] = frozenset(found)
        return found

    def counting(self, views: Mapping[str, ViewSet], world: Mapping[str, Pose], epochs: Epochs,
                 accepted: Pairs | None, farthest: float) -> list[ToldBond]:
        """
        Return the bonds that count.

        views: that came, by robot; world: T_world_map by robot; accepted: who accepts its pair
        with whom, None if all do; farthest [m] that matches may have a map from there.
        """
        return [bond for bonds in self._bonds.values() for bond in bonds
                if {bond.target, bond.source} <= views.keys()
                and bond.epochs == (epochs[bond.target], epochs[bond.source])
                and (accepted is None or {(bond.source, bond.target),
                                          (bond.target, bond.source)} <= {*accepted})
                and bond.target not in self.refuted.get(bond.source, ())
                and _known(bond.matches, views) and astray(views, world, bond) < farthest]


def _between(mine: ToldBond | None, told: ToldBond, views: Mapping[str, ViewSet],
             T_own_peer: Pose) -> float:
    """Return how far [m] a bond has the source's views, in the median, from another, or a pose."""
    own, (k, there) = views[told.source].poses, _seen(told.matches, views)
    if mine is None:
        here = compose(inverse(T_own_peer), own[k])
    else:
        j, matched = _seen(mine.matches, views)
        near = np.abs(k[:, None] - j).argmin(axis=1)      # on the path
        here = compose(matched[near], between(own[j[near]], own[k]))
    return float(np.median(np.hypot(*(there - here)[:, :2].T)))


def _known(matches: tuple[InterMatch, ...], views: Mapping[str, ViewSet]) -> bool:
    """Return whether all views that matches join have come."""
    return bool(matches) and all(m.target_view < len(views[m.target])
                                 and m.source_view < len(views[m.source]) for m in matches)


def _seen(matches: tuple[InterMatch, ...], views: Mapping[str, ViewSet]) -> tuple[Array, Array]:
    """Return views (n,) of the source, and where (n, 3) the target has them in its map."""
    target = views[matches[0].target].poses[[m.target_view for m in matches]]
    return (np.array([m.source_view for m in matches]),
            compose(target, np.array([m.z for m in matches])))
