# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Marginalised views: where they hang between the anchors that stay in the filter."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, between, between_jacobians, compose
from somfusion_ros.slam.constraint import Constraint

ANCHORS = 4   # one of so many old views is an anchor, where the map is not long
SHORT = 3     # views of a chain so short that it hangs on the view that it was begun from


def ends(k: int, parents: NDArray[np.intp], every: int) -> tuple[int, int] | None:
    """
    Return the views between which view k hangs once it is marginalised; None for an anchor.

    Of a chain of views that follow one another both ends are anchors, and one of `every` views
    between. A short chain was added where the place was known: both ends are the view that the
    chain was begun from, which may hang itself.
    """
    if every == 1:
        return None
    begin = end = k
    while begin > k - SHORT and parents[begin] == begin - 1:
        begin -= 1
    while end < k + SHORT and parents[end + 1] == end:
        end += 1
    short = end - begin < SHORT and parents[begin] != begin - 1 and parents[end + 1] != end
    if begin > 0 and short:
        return int(parents[begin]), int(parents[begin])
    if _stays(k, parents, every):
        return None
    before, after = k - 1, k + 1
    while not _stays(before, parents, every):
        before -= 1
    while not _stays(after, parents, every):
        after += 1
    return before, after


def loosely(before: int, after: int, every: int) -> bool:
    """Return whether a view is less sure than its anchors: not between two near ones."""
    return before == after or every > ANCHORS


def surplus(kept: NDArray[np.bool_], parents: NDArray[np.intp], every: int) -> list[int]:
    """Return the anchors, of the old views' mask kept (m,), that go where one of `every` stays."""
    return [k for k in np.flatnonzero(kept).tolist()
            if k > 0 and ends(k, parents, every) is not None]


def anew(views: Sequence[int], parents: NDArray[np.intp], every: int,
         anchor: Callable[[int], int]) -> list[tuple[int, int, int]]:
    """
    Return the views that hang anew once an anchor goes, and the anchors before and after each.

    views: that anchor, and those that hang on it; anchor(k): the anchor of any other view.
    """
    first, hung = dict[int, int](), []
    for k in sorted(views):
        between_ends = ends(k, parents, every)
        if between_ends is not None:
            before, after = (first[end] if end in first else anchor(end) for end in between_ends)
            first[k] = before
            hung.append((k, before, after))
    return hung


def carried(constraint: Constraint, anchors: tuple[int, int], poses: Array, loose_first: Array,
            loose_second: Array) -> Constraint:
    """
    Carry a constraint over to the anchors of its views, which are taken to be rigid.

    loose: the covariances (3, 3) of its views beyond their anchors'.
    """
    (i, j), first, second = anchors, constraint.first, constraint.second
    z = compose(compose(between(poses[i], poses[first]), constraint.z),
                between(poses[second], poses[j]))
    A, B = between_jacobians(poses[first], poses[second])
    R = constraint.R + A @ loose_first @ A.T + B @ loose_second @ B.T
    return Constraint(i, j, z, R)


def _stays(k: int, parents: NDArray[np.intp], every: int) -> bool:
    """Return whether a view of a long chain is an anchor."""
    return bool(parents[k] != k - 1 or parents[k + 1] != k or k % every == 0)


class Hanging:
    """
    The anchors (n, 2) of views, and their poses (n, 2, 3) seen from both; room for n views.

    Covariances (n, 3, 3) of those that hang on one anchor only; between two they are taken to be
    as sure as these.
    """

    def __init__(self, room: int) -> None:
        self._anchors = np.full((room, 2), -1)
        self._seen = np.zeros((room, 2, 3))
        self._R = np.zeros((room, 3, 3))

    def make_room(self, more: int) -> None:
        """Make room for more views."""
        self._anchors = np.concatenate([self._anchors, np.full((more, 2), -1)])
        self._seen = np.concatenate([self._seen, np.zeros((more, 2, 3))])
        self._R = np.concatenate([self._R, np.zeros((more, 3, 3))])

    def hang(self, k: int, before: int, after: int, poses: Array, R: Array) -> None:
        """Hang view k between two anchors, as they lie at poses (n, 3), known to R (3, 3)."""
        self._anchors[k], self._R[k] = (before, after), R
        self.renew(poses, np.array([k]))

    def anchor(self, k: int) -> int:
        """Return the first anchor of a view that hangs."""
        return int(self._anchors[k, 0])

    def on(self, anchor: int) -> list[int]:
        """Return the views that hang on an anchor."""
        views: list[int] = np.flatnonzero((self._anchors == anchor).any(1)).tolist()
        return views

    def spread(self, k: int) -> Array:
        """Return the covariance (3, 3) of view k seen from its first anchor."""
        R: Array = self._R[k]
        return R

    def renew(self, poses: Array, k: NDArray[np.intp]) -> None:
        """Let views k (m,) hang as they lie at poses (n, 3)."""
        for end in range(2):
            self._seen[k, end] = between(poses[self._anchors[k, end]], poses[k])

    def follow(self, poses: Array, k: NDArray[np.intp]) -> None:
        """Move views k (m,) of poses (n, 3) with their anchors."""
        before, after = self._anchors[k].T
        a, b = (compose(poses[self._anchors[k, end]], self._seen[k, end]) for end in range(2))
        share = (k - before) / np.maximum(after - before, 1)
        poses[k] = compose(a, share[:, None] * between(a, b))
