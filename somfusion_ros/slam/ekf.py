# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Delayed-state EKF: the mean and covariance of every kept view pose.

The state x = [x_1 ... x_n] holds the pose T_map_view of each view; the current pose is one more
motion away from the last (section II-A; Eustice et al. 2006). A new view costs one row of P, a
loop closure one symmetric rank-3 update of the lower triangle of P.

Of the old views only every few stay in P, as anchors: the others are marginalised, which in
covariance form is to forget their rows, and hang between their anchors from then on. Where P is
full of anchors, every second one is marginalised too: a long map is held by fewer.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk
from somfusion_ros.geometry import (Array, between, between_jacobians, compose, compose_jacobians,
                                    difference, wrap)
from somfusion_ros.slam import hanging, smoothing
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.reduction import reduce_to

GROWTH = 64    # views of room that P grows by, at least
RECENT = 64    # newest views, which all stay in P
MOST = 1000    # views in P: 72 MB, and 10 ms to fuse a loop
LARGE = 500    # views in P, from which on it is given room for all at once: a copy of 18 MB
AT_ONCE = 4    # anchors that are let go with a new view: 2 to 8 ms


class DelayedStateEkf:
    """Mean (n, 3) and covariance of n view poses in the map frame; view 0 is the origin."""

    def __init__(self, anchors: int = hanging.ANCHORS) -> None:
        self.n = 0
        self._anchors = anchors
        self._x = np.zeros((GROWTH, 3))
        self._P = np.zeros((3 * GROWTH, 3 * GROWTH), order='F')
        self._slot = np.full(GROWTH, -1)       # place of each view in P, -1: marginalised
        self._free = list(range(GROWTH))[::-1]
        self._hanging = hanging.Hanging(GROWTH)        # marginalised views
        self._surplus = list[int]()            # anchors that are to be let go
        self.parents = np.arange(-1, GROWTH)   # view that each view was added from

    @property
    def poses(self) -> Array:
        """View poses T_map_view (n, 3); a view of the state, not a copy."""
        return self._x[:self.n]

    @property
    def begins(self) -> NDArray[np.intp]:
        """First views (m,) of the chains of views that follow one another."""
        begins = self.parents[:self.n] != np.arange(-1, self.n - 1)
        begins[:1] = True
        return np.flatnonzero(begins)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Mask (n,) of the views that are in P."""
        return self._slot[:self.n] >= 0

    def augment(self, T_view_new: Array, Q: Array, view: int | None = None) -> int:
        """
        Add a view at T_view_new (3,), with covariance Q (3, 3), from another, by default the last.

        The first view, with any arguments, is the origin and certain. Returns the view's index.
        """
        self._marginalise(self.n - RECENT)
        self._thin()
        self._make_room()
        k = self.n
        self._slot[k] = self._free.pop()
        s = self._rows(k)
        column = np.zeros((len(self._P), 3))
        if k > 0:
            view = k - 1 if view is None else view
            self.parents[k] = view
            self._x[k] = compose(self._x[view], T_view_new)
            a, F, Q = self._ahead(view, T_view_new, Q)
            column = self._column(a) @ F.T
            column[s] = F @ self.block(a, a) @ F.T + Q
        self._P[s, :s.stop] = column[:s.stop].T
        self._P[s.start:, s] = column[s.start:]
        self.n += 1
        return k

    def _marginalise(self, k: int) -> None:
        """Marginalise view k unless it is an anchor; do nothing where there is no such view."""
        ends = hanging.ends(k, self.parents, self._anchors) if k > 0 else None
        if ends is not None:
            before, after = self._anchor(ends[0]), self._anchor(ends[1])
            R = self.relative(before, k)[1]
            self._let_go(k, before, after,
                         R * hanging.loosely(before, after, self._anchors))

    def _thin(self) -> None:
        """Where P is full, let every second anchor of long chains go, a few with each view."""
        if not self._surplus and self.kept.sum() >= MOST and 2 * self._anchors < RECENT:
            self._anchors *= 2
            self._surplus = hanging.surplus(self.kept[:self.n - RECENT], self.parents,
                                            self._anchors)
        for anchor in self._surplus[:AT_ONCE]:
            views = [anchor, *self._hanging.on(anchor)]
            anew = hanging.anew(views, self.parents, self._anchors, self._anchor)
            spread = [self.relative(before, k)[1] for k, before, _ in anew]
            for (k, before, after), R in zip(anew, spread, strict=True):
                self._let_go(k, before, after, R)
        del self._surplus[:AT_ONCE]

    def _let_go(self, k: int, before: int, after: int, R: Array) -> None:
        """Let view k hang between two anchors, seen from the first with covariance R (3, 3)."""
        if self._slot[k] >= 0:
            self._free.append(int(self._slot[k]))
            self._slot[k] = -1
        self._hanging.hang(k, before, after, self._x, R)

    def _loose(self, k: int) -> Array:
        """Return the covariance (3, 3) that view k has beyond its anchor's."""
        if self._slot[k] >= 0:
            return np.zeros((3, 3))
        a = self._hanging.anchor(k)
        _, G = compose_jacobians(self._x[a], between(self._x[a], self._x[k]))
        return np.asarray(G @ self._hanging.spread(k) @ G.T)

    def _anchor(self, k: int) -> int:
        """Return view k, or the anchor before it where view k is not in P."""
        return k if self._slot[k] >= 0 else self._hanging.anchor(k)

    def _anchored(self, constraint: Constraint) -> Constraint:
        """Carry a constraint over to the anchors of its views, which are taken to be rigid."""
        views = constraint.first, constraint.second
        anchors = self._anchor(views[0]), self._anchor(views[1])
        return constraint if anchors == views else hanging.carried(
            constraint, anchors, self._x, *map(self._loose, views))

    def ahead(self, T_view_base: Array, Q: Array, view: int) -> tuple[Array, Array]:
        """Return pose (3,) and covariance (3, 3) in the map after a motion from a view."""
        a, F, Q = self._ahead(view, T_view_base, Q)
        return compose(self._x[view], T_view_base), F @ self.block(a, a) @ F.T + Q

    def _ahead(self, view: int, T_view_base: Array, Q: Array) -> tuple[int, Array, Array]:
        """Return a view's anchor, the Jacobian of a pose ahead in it, and what comes beside it."""
        F, G = compose_jacobians(self._x[view], T_view_base)
        Q = G @ Q @ G.T + F @ self._loose(view) @ F.T
        a = self._anchor(view)
        if a != view:
            F = F @ compose_jacobians(self._x[a], between(self._x[a], self._x[view]))[0]
        return a, F, Q

    def _make_room(self) -> None:
        """Enlarge x and P before they are full."""
        if self.n == len(self._x):
            more = self.n + max(GROWTH, self.n // 8)
            self._x = np.concatenate([self._x, np.zeros((more - self.n, 3))])
            self._hanging.make_room(more - self.n)
            self._slot = np.concatenate([self._slot, np.full(more - self.n, -1)])
            self.parents = np.concatenate([self.parents, np.arange(self.n, more)])
        if not self._free:
            room = len(self._P) // 3
            more = MOST + GROWTH if LARGE <= room < MOST else room + max(GROWTH, room // 8)
            P = np.zeros((3 * more, 3 * more), order='F')
            P[:3 * room, :3 * room] = self._P
            self._P, self._free = P, list(range(room, more))[::-1]

    def _rows(self, k: int) -> slice:
        """Return the rows of P that belong to view k."""
        return slice(3 * int(self._slot[k]), 3 * int(self._slot[k]) + 3)

    def block(self, i: int, j: int) -> Array:
        """Return the covariance (3, 3) between views i and j, which are in P."""
        if self._slot[i] < self._slot[j]:
            return self.block(j, i).T
        B = self._P[self._rows(i), self._rows(j)].copy()
        if i == j:
            B[0, 1], B[0, 2], B[1, 2] = B[1, 0], B[2, 0], B[2, 1]
        return B

    def relative(self, i: int, j: int) -> tuple[Array, Array]:
        """Return the pose (3,) of view j seen from view i, and its covariance (3, 3)."""
        A, B = between_jacobians(self._x[i], self._x[j])
        a, b = self._anchor(i), self._anchor(j)
        C = A @ self.block(a, b) @ B.T
        return (between(self._x[i], self._x[j]),
                A @ (self.block(a, a) + self._loose(i)) @ A.T
                + B @ (self.block(b, b) + self._loose(j)) @ B.T + C + C.T)

    def innovation(self, constraint: Constraint) -> tuple[Array, Array]:
        """Return the innovation z - h(x) (3,) and its covariance S (3, 3)."""
        constraint = self._anchored(constraint)
        h, P_h = self.relative(constraint.first, constraint.second)
        return difference(constraint.z, h), P_h + constraint.R

    def update(self, constraint: Constraint) -> float:
        """
        Fuse a loop closure into every view; return how far [m] the mean moved at most.

        The state becomes x + K y, P - K S K', with K = P H' inv(S), by one rank-3 dsyrk.
        """
        constraint = self._anchored(constraint)
        i, j = constraint.first, constraint.second
        y, S = self.innovation(constraint)
        A, B = between_jacobians(self._x[i], self._x[j])
        PH = self._column(i) @ A.T + self._column(j) @ B.T
        L = np.linalg.cholesky(S)
        W = np.linalg.solve(L, PH.T)
        self._P = dsyrk(-1.0, W, beta=1.0, c=self._P, trans=1, lower=1, overwrite_c=1)
        step, kept = W.T @ np.linalg.solve(L, y), np.flatnonzero(self.kept)
        move = step.reshape(-1, 3)[self._slot[kept]]
        self._x[kept] += move
        self._x[:, 2] = wrap(self._x[:, 2])
        self._hanging.follow(self._x, np.flatnonzero(~self.kept))
        return float(np.hypot(move[:, 0], move[:, 1]).max())

    @classmethod
    def of(cls, poses: Array, constraints: Sequence[Constraint]) -> 'DelayedStateEkf':
        """Return the filter of views at poses (n, 3), there linearised, of constraints by age."""
        reduced = reduce_to(MOST, poses, constraints, RECENT)
        ekf, n, kept = cls(reduced.every), len(poses), np.flatnonzero(reduced.kept)
        ekf.n, K = n, len(kept)
        ekf._x = np.concatenate([poses, np.zeros((GROWTH, 3))])
        ekf.parents = np.concatenate([reduced.parents[:n], np.arange(n - 1, n + GROWTH)])
        ekf._slot = np.full(n + GROWTH, -1)
        ekf._slot[kept], ekf._free = np.arange(K), list(range(K, K + GROWTH))[::-1]
        ekf._P = np.zeros((3 * (K + GROWTH), 3 * (K + GROWTH)), order='F')
        if K > 1:
            ekf._P[:3 * K, :3 * K] = smoothing.covariance(poses[kept], reduced.between_kept())
        ekf._hanging = hanging.Hanging(n + GROWTH)
        for k in np.flatnonzero(~reduced.kept).tolist():
            before, after = reduced.anchors[k].tolist()
            ekf._hanging.hang(k, before, after, poses, reduced.spread[k])
        return ekf

    def _column(self, i: int) -> Array:
        """Return the columns (3 * room, 3) of P that belong to view i, from the lower triangle."""
        P, s = self._P, self._rows(i)
        column = P[:, s].copy()
        column[:s.start] = P[s, :s.start].T
        column[s] = self.block(i, i)
        return column

    def relinearise(self, poses: Array) -> None:
        """Put a re-solved mean (m, 3) back in the filter; views added since follow rigidly."""
        m, old = len(poses), self._x[:self.n].copy()
        self._x[:m] = poses
        for k in range(m, self.n):
            parent = self.parents[k]
            self._x[k] = compose(self._x[parent], between(old[parent], old[k]))
        self._hanging.renew(self._x, np.flatnonzero(~self.kept))
