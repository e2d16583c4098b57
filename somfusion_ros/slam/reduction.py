# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Constraints between the anchors of a filter that stand for the constraints of all its views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import (Array, between, between_jacobians, compose,
                                    compose_jacobians)
from somfusion_ros.slam import hanging
from somfusion_ros.slam.constraint import Constraint


@dataclass(frozen=True, eq=False)
class Reduction:
    """
    The anchors among n views, and what ties them.

    every: spacing of the anchors along a chain; parents (n + every + 1,): view that each was added
    from; anchors (n, 2): those between which each view hangs, itself where it is one; spread
    (n, 3, 3): covariance of each view beyond its first anchor's; constraints between anchors.
    """

    every: int
    parents: NDArray[np.intp]
    anchors: NDArray[np.intp]
    spread: Array
    constraints: list[Constraint]

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Mask (n,) of the anchors."""
        mask: NDArray[np.bool_] = self.anchors[:, 0] == np.arange(len(self.anchors))
        return mask

    def between_kept(self) -> list[Constraint]:
        """Return the constraints by the places of the anchors among the anchors."""
        place = np.cumsum(self.kept) - 1
        return [Constraint(int(place[c.first]), int(place[c.second]), c.z, c.R)
                for c in self.constraints]


def reduce_to(most: int, poses: Array, constraints: Sequence[Constraint], recent: int
              ) -> Reduction:
    """Reduce views, of which the newest `recent` all stay, to fewer than `most` anchors."""
    reduced = reduce(poses, constraints, hanging.ANCHORS, recent)
    while reduced.kept.sum() >= most and 2 * reduced.every < recent:
        reduced = reduce(poses, constraints, 2 * reduced.every, recent)
    return reduced


def reduce(poses: Array, constraints: Sequence[Constraint], every: int, recent: int) -> Reduction:
    """
    Choose anchors among views at poses (n, 3), and carry the constraints, by age, over to them.

    One of `every` views of a chain is an anchor, and the newest `recent` all are.
    """
    n = len(poses)
    parents, first = np.arange(-1, n + every), dict[int, Constraint]()
    for c in constraints:
        if c.second not in first:
            first[c.second] = c
            parents[c.second] = c.first
    anchors, spread, reduced = np.stack([np.arange(n)] * 2, 1), np.zeros((n, 3, 3)), []
    way = np.zeros((n, 3, 3))    # covariance of each view seen from its first anchor
    for k in range(1, n):
        step = _from_anchor(first[k], poses, int(anchors[parents[k], 0]), way[parents[k]])
        ends = hanging.ends(k, parents, every) if k < n - recent else None
        if ends is None:
            reduced.append(step)
            continue
        before, after = anchors[list(ends), 0].tolist()
        anchors[k], way[k] = (before, after), step.R
        if hanging.loosely(before, after, every):
            spread[k] = step.R
    loops = [c for c in constraints if c is not first[c.second]]
    return Reduction(every, parents, anchors, spread,
                     reduced + _carried(loops, poses, anchors[:, 0], spread))


def _from_anchor(c: Constraint, poses: Array, a: int, spread: Array) -> Constraint:
    """Return a view's first constraint, from the anchor a of its parent, known to spread."""
    F, G = compose_jacobians(between(poses[a], poses[c.first]),
                             between(poses[c.first], poses[c.second]))
    return Constraint(a, c.second, between(poses[a], poses[c.second]),
                      F @ spread @ F.T + G @ c.R @ G.T)


def _carried(loops: Sequence[Constraint], poses: Array, anchor: NDArray[np.intp], spread: Array
             ) -> list[Constraint]:
    """Return constraints carried over to the anchors (n,) of their views, where these differ."""
    views = np.array([(c.first, c.second) for c in loops], int).reshape(-1, 2)
    (a, b), (i, j) = views.T, anchor[views].T
    z = np.array([c.z for c in loops]).reshape(-1, 3)
    z = compose(compose(between(poses[i], poses[a]), z), between(poses[b], poses[j]))
    R = np.array([c.R for c in loops]).reshape(-1, 3, 3)
    for view, at, J in zip((a, b), (i, j), between_jacobians(poses[a], poses[b]), strict=True):
        J = J @ _turns(poses[at, 2])
        R = R + J @ spread[view] @ J.transpose(0, 2, 1)
    return [Constraint(int(i[k]), int(j[k]), z[k], R[k]) for k in np.flatnonzero(i != j)]


def _turns(theta: Array) -> Array:
    """Return matrices (m, 3, 3) that turn small pose errors by angles (m,) [rad]."""
    turns = np.zeros((len(theta), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(theta)
    turns[:, 1, 0] = np.sin(theta)
    turns[:, 0, 1], turns[:, 2, 2] = -turns[:, 1, 0], 1.0
    return turns
