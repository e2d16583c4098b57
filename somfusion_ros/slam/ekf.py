# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Delayed-state EKF: the mean and covariance of every kept view pose.

The state x = [x_1 ... x_n] holds the pose T_map_view of each view; the current pose is one more
motion away from the last (section II-A; Eustice et al. 2006). A new view costs one row of P, a
loop closure one symmetric rank-3 update of the lower triangle of P.
"""

import numpy as np
from scipy.linalg.blas import dsyrk

from somfusion_ros.geometry import (
    Array, between, between_jacobians, compose, compose_jacobians, wrap)
from somfusion_ros.slam.relation import Relation

GROWTH = 64  # views of room that P grows by, at least


class DelayedStateEkf:
    """Mean (n, 3) and covariance of n view poses in the map frame; view 0 is the origin."""

    def __init__(self) -> None:
        self.n = 0
        self._x = np.zeros((GROWTH, 3))
        self._P = np.zeros((3 * GROWTH, 3 * GROWTH), order='F')

    @property
    def poses(self) -> Array:
        """View poses T_map_view (n, 3); a view of the state, not a copy."""
        return self._x[:self.n]

    def augment(self, T_view_new: Array, Q: Array) -> int:
        """
        Add a view at T_view_new (3,), with covariance Q (3, 3), from the last view.

        The first view, with any arguments, is the origin and certain. Returns the view's index.
        """
        self._make_room()
        k = self.n
        if k > 0:
            x, P, last = self._x, self._P, slice(3 * k - 3, 3 * k)
            F, G = compose_jacobians(x[k - 1], T_view_new)
            x[k] = compose(x[k - 1], T_view_new)
            new = slice(3 * k, 3 * k + 3)
            P_last = self.block(k - 1, k - 1)
            P[new, :3 * k - 3] = F @ P[last, :3 * k - 3]
            P[new, last] = F @ P_last
            P[new, new] = F @ P_last @ F.T + G @ Q @ G.T
        self.n += 1
        return k

    def ahead(self, T_view_base: Array, Q: Array) -> tuple[Array, Array]:
        """Give the pose (3,) in the map, and covariance (3, 3), of a motion from the last view."""
        last = self.n - 1
        F, G = compose_jacobians(self._x[last], T_view_base)
        return (compose(self._x[last], T_view_base),
                F @ self.block(last, last) @ F.T + G @ Q @ G.T)

    def _make_room(self) -> None:
        """Let P and x grow before they are full."""
        room = len(self._x)
        if self.n < room:
            return
        more = room + max(GROWTH, room // 8)
        x, P = np.zeros((more, 3)), np.zeros((3 * more, 3 * more), order='F')
        x[:room], P[:3 * room, :3 * room] = self._x, self._P
        self._x, self._P = x, P

    def block(self, i: int, j: int) -> Array:
        """Covariance (3, 3) between views i and j."""
        if i < j:
            return self.block(j, i).T
        B = self._P[3 * i:3 * i + 3, 3 * j:3 * j + 3]
        return np.tril(B) + np.tril(B, -1).T if i == j else B.copy()

    def relative(self, i: int, j: int) -> tuple[Array, Array]:
        """Pose (3,) of view j seen from view i, and its covariance (3, 3)."""
        A, B = between_jacobians(self._x[i], self._x[j])
        C = A @ self.block(i, j) @ B.T
        return (between(self._x[i], self._x[j]),
                A @ self.block(i, i) @ A.T + B @ self.block(j, j) @ B.T + C + C.T)

    def innovation(self, relation: Relation) -> tuple[Array, Array]:
        """Give z - h(x) (3,) and its covariance S (3, 3)."""
        h, P_h = self.relative(relation.first, relation.second)
        y = relation.z - h
        y[2] = wrap(y[2])
        return y, P_h + relation.R

    def update(self, relation: Relation) -> float:
        """
        Fuse a loop closure into every view; return how far [m] the mean moved at most.

        The state becomes x + K y, P - K S K', with K = P H' inv(S), by one rank-3 dsyrk.
        """
        i, j = relation.first, relation.second
        y, S = self.innovation(relation)
        A, B = between_jacobians(self._x[i], self._x[j])
        PH = self._column(i) @ A.T + self._column(j) @ B.T
        L = np.linalg.cholesky(S)
        W = np.linalg.solve(L, PH.T)
        move = (W.T @ np.linalg.solve(L, y)).reshape(-1, 3)
        self._x += move
        self._x[:, 2] = wrap(self._x[:, 2])
        self._P = dsyrk(-1.0, W, beta=1.0, c=self._P, trans=1, lower=1, overwrite_c=1)
        return float(np.hypot(move[:self.n, 0], move[:self.n, 1]).max())

    def _column(self, i: int) -> Array:
        """Columns (3 * room, 3) of P that belong to view i, from the lower triangle."""
        P, s = self._P, slice(3 * i, 3 * i + 3)
        column = P[:, s].copy()
        column[:3 * i] = P[s, :3 * i].T
        column[s] = self.block(i, i)
        return column

    def relinearise(self, poses: Array, covariance: Array | None = None) -> None:
        """
        Put a re-solved mean (m, 3), and covariance (3 m, 3 m) if given, back in the filter.

        Views added since the re-solving, after the first m, follow rigidly.
        """
        m, old = len(poses), self._x[:self.n].copy()
        self._x[:m] = poses
        if m < self.n:
            self._x[m:self.n] = compose(poses[-1], between(old[m - 1], old[m:]))
        if covariance is not None and m == self.n:
            self._P[:3 * m, :3 * m] = covariance
