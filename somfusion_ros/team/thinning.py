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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, between, compose, inverse
from somfusion_ros.slam.constraint import Constraint


class Constraints(NamedTuple):
    """Many constraints at once: first, second (m,) of what they join, z (m, 3), R (m, 3, 3)."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    z: Array
    R: Array

    @classmethod
    def of(cls, constraints: Sequence[Constraint]) -> 'Constraints':
        """Put constraints into arrays."""
        return cls(np.array([c.first for c in constraints], np.intp),
                   np.array([c.second for c in constraints], np.intp),
                   np.array([c.z for c in constraints], float).reshape(-1, 3),
                   np.array([c.R for c in constraints], float).reshape(-1, 3, 3))


class Spine:
    """
    The nodes of a path, and how the views between hang on them.

    steps (n - 1): the k-th leads to view k + 1 from one before it, so that the path is a tree.
    Nodes are its root, its ends and forks, and every so many views between. nodes (m,) are view
    numbers; links are the composed constraints between neighbouring nodes, numbered as nodes.
    """

    def __init__(self, steps: Sequence[Constraint], every: int) -> None:
        path = Constraints.of(steps)
        n = len(steps) + 1
        self._parents = np.concatenate([[-1], path.first])
        self._step_z = np.concatenate([np.zeros((1, 3)), path.z])
        self._step_R = np.concatenate([np.zeros((1, 3, 3)), path.R])
        since = _since(self._parents.tolist(), every)
        ahead = _ahead(self._parents.tolist(), since)
        self.nodes = np.flatnonzero(np.array(since) == 0)
        number = np.full(n, -1)
        number[self.nodes] = np.arange(len(self.nodes))
        self._before, self._after = number.copy(), number.copy()
        self._z, self._R = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self._end_z, self._end_R = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self._reach(np.array(since))
        self._precede(np.array(ahead))
        self.links = self._link(number)

    def _reach(self, since: NDArray[np.intp]) -> None:
        """Hang views on the nodes before them: all that are one step from one, then two, ..."""
        for steps in range(1, int(since.max()) + 1):
            views = np.flatnonzero(since == steps)
            parents = self._parents[views]
            self._before[views] = self._before[parents]
            self._z[views], self._R[views] = self._ahead_of(parents, views)

    def _precede(self, ahead: NDArray[np.intp]) -> None:
        """Let views know the nodes after them: all that are one step from one, then two, ..."""
        children = np.zeros(len(ahead), np.intp)     # of views between nodes, which have one
        children[self._parents[1:]] = np.arange(1, len(ahead))
        for steps in range(1, int(ahead.max()) + 1):
            views = np.flatnonzero(ahead == steps)
            after = children[views]
            self._after[views] = self._after[after]
            self._end_z[views], self._end_R[views] = _then(
                self._step_z[after], self._step_R[after], self._end_z[after], self._end_R[after])

    def _link(self, number: NDArray[np.intp]) -> Constraints:
        """Compose the steps between neighbouring nodes."""
        ends = self.nodes[1:]
        parents = self._parents[ends]
        return Constraints(self._before[parents], number[ends], *self._ahead_of(parents, ends))

    def _ahead_of(self, parents: NDArray[np.intp], views: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return where views lie from the node before their parents, and the covariances."""
        return _then(self._z[parents], self._R[parents], self._step_z[views],
                     self._step_R[views])

    def hang(self, views: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array]:
        """Return the nodes (m,) best known from views, the views' poses in them, covariances."""
        near = np.trace(self._R[views], axis1=1, axis2=2) <= np.trace(
            self._end_R[views], axis1=1, axis2=2)
        z, R = self._end_z[views], self._end_R[views]
        return (np.where(near, self._before[views], self._after[views]),
                np.where(near[:, None], self._z[views], inverse(z)),
                np.where(near[:, None, None], self._R[views], _inverted(z, R)))

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


def hung(constraints: Constraints, first: Spine, second: Spine) -> Constraints:
    """Move constraints between views of two paths to the nodes on which they hang."""
    a, T_a_i, P_i = first.hang(constraints.first)
    b, T_b_j, P_j = second.hang(constraints.second)
    z, R = _then(T_a_i, P_i, constraints.z, constraints.R)
    return Constraints(a, b, *_then(z, R, inverse(T_b_j), _inverted(T_b_j, P_j)))


def _since(parents: list[int], every: int) -> list[int]:
    """Return how many steps each view lies after a node, 0 for a node."""
    children = np.bincount(np.array(parents[1:], int), minlength=len(parents)).tolist()
    since = [0] * len(parents)
    for view in range(1, len(parents)):
        steps = since[parents[view]] + 1
        since[view] = 0 if children[view] != 1 or steps >= every else steps
    return since


def _ahead(parents: list[int], since: list[int]) -> list[int]:
    """Return how many steps each view lies before a node, 0 for a node."""
    ahead = [0] * len(parents)
    for view in range(len(parents) - 1, 0, -1):
        if since[parents[view]]:
            ahead[parents[view]] = ahead[view] + 1
    return ahead


def _then(z: Array, R: Array, step: Array, Q: Array) -> tuple[Array, Array]:
    """Compose poses (m, 3) with covariances (m, 3, 3) and next ones."""
    c, s = np.cos(z[:, 2]), np.sin(z[:, 2])
    F, G = np.tile(np.eye(3), (2, len(z), 1, 1))
    F[:, 0, 2] = -s * step[:, 0] - c * step[:, 1]
    F[:, 1, 2] = c * step[:, 0] - s * step[:, 1]
    G[:, 0, 0], G[:, 0, 1], G[:, 1, 0], G[:, 1, 1] = c, -s, s, c
    return compose(z, step), (F @ R @ F.transpose(0, 2, 1) + G @ Q @ G.transpose(0, 2, 1))


def _inverted(z: Array, R: Array) -> Array:
    """Return the covariances (m, 3, 3) of the inverses of poses (m, 3) with covariances."""
    c, s = np.cos(z[:, 2]), np.sin(z[:, 2])
    x, y = -(c * z[:, 0] + s * z[:, 1]), -(-s * z[:, 0] + c * z[:, 1])
    J = np.zeros((len(z), 3, 3))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = -c, -s, y
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = s, -c, -x
    J[:, 2, 2] = -1.0
    found: Array = J @ R @ J.transpose(0, 2, 1)
    return found
