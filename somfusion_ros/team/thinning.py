# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A robot's path with fewer nodes and the same information.

Only some views are nodes of the team's problem. The steps between two nodes are composed into
one, with its covariance, which loses nothing (marginalisation of a Markov chain, Eustice et al.
2006). A constraint of a view in between hangs on the nearer node by the steps from there, whose
covariance it takes over.
"""

from collections.abc import Sequence

import numpy as np
from somfusion_ros.geometry import Array, between, compose, compose_jacobians, inverse
from somfusion_ros.slam.constraint import Constraint


class Spine:
    """
    The nodes of a path, and how the views between hang on them.

    steps (n - 1): the k-th leads to view k + 1 from one before it, so that the path is a tree.
    Nodes are its root, its ends and forks, and every so many views between. nodes (m,) are view
    numbers; links are the composed constraints between neighbouring nodes, numbered as nodes.
    """

    def __init__(self, steps: Sequence[Constraint], every: int) -> None:
        self._steps, n = steps, len(steps) + 1
        parents = np.array([-1, *(step.first for step in steps)])
        children = np.bincount(parents[1:], minlength=n)
        since = np.zeros(n, int)      # views since the node before
        for view in range(1, n):
            since[view] = since[parents[view]] + 1
            if children[view] != 1 or since[view] >= every:
                since[view] = 0
        self.nodes = np.flatnonzero(since == 0)
        number = np.full(n, -1)
        number[self.nodes] = np.arange(len(self.nodes))
        self._before, self._after = number.copy(), number.copy()
        self._z, self._R = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self._end_z, self._end_R = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self.links: list[Constraint] = []
        for view in range(1, n):
            self._reach(view, int(parents[view]), int(number[view]))
        for view in range(n - 1, 0, -1):
            self._precede(view, int(parents[view]), int(number[parents[view]]))

    def _reach(self, view: int, parent: int, node: int) -> None:
        """Hang a view on the node before it; where it is a node itself, link it."""
        step, before = self._steps[view - 1], int(self._before[parent])
        z, R = _then(self._z[parent], self._R[parent], step.z, step.R)
        if node >= 0:
            self.links.append(Constraint(before, node, z, R))
        else:
            self._before[view], self._z[view], self._R[view] = before, z, R

    def _precede(self, view: int, parent: int, node: int) -> None:
        """Let the view before this one know the node after it, and how that lies from there."""
        if node < 0:
            step = self._steps[view - 1]
            self._after[parent] = self._after[view]
            self._end_z[parent], self._end_R[parent] = _then(
                step.z, step.R, self._end_z[view], self._end_R[view])

    def hang(self, view: int) -> tuple[int, Array, Array]:
        """Return the node best known from a view, the view's pose (3,) in it, its covariance."""
        if np.trace(self._R[view]) <= np.trace(self._end_R[view]):
            return int(self._before[view]), self._z[view], self._R[view]
        z, R = self._end_z[view], self._end_R[view]
        return int(self._after[view]), inverse(z), _inverted(z, R)

    def follow(self, poses: Array) -> Array:
        """
        Return the poses (n, 3) of all views where the nodes lie at poses (m, 3).

        What the solution moved one node against the next is shared among the views between, as
        their covariance grows.
        """
        near = compose(poses[self._before], self._z)
        far = compose(poses[self._after], inverse(self._end_z))
        grown, left = (np.trace(R, axis1=1, axis2=2) for R in (self._R, self._end_R))
        share = grown / np.maximum(grown + left, 1e-12)
        return compose(near, share[:, None] * between(near, far))


def _then(z: Array, R: Array, step: Array, Q: Array) -> tuple[Array, Array]:
    """Compose a pose (3,) with covariance (3, 3) and a next one."""
    F, G = compose_jacobians(z, step)
    return compose(z, step), F @ R @ F.T + G @ Q @ G.T


def _inverted(z: Array, R: Array) -> Array:
    """Return the covariance (3, 3) of the inverse of a pose (3,) with covariance (3, 3)."""
    c, s = np.cos(z[2]), np.sin(z[2])
    x, y = -(c * z[0] + s * z[1]), -(-s * z[0] + c * z[1])
    J = -np.array(((c, s, -y), (-s, c, x), (0.0, 0.0, 1.0)))
    found: Array = J @ R @ J.T
    return found


def hung(constraint: Constraint, first: Spine, second: Spine) -> Constraint:
    """Move a constraint between two views to the nodes on which they hang."""
    a, T_a_i, P_i = first.hang(constraint.first)
    b, T_b_j, P_j = second.hang(constraint.second)
    z, R = _then(T_a_i, P_i, constraint.z, constraint.R)
    z, R = _then(z, R, inverse(T_b_j), _inverted(T_b_j, P_j))
    return Constraint(a, b, z, R)
