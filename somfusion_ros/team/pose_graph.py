# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least squares over a few poses that are tied by measured relative poses.

A team has at most some tens of robots, so dense matrices and plain Gauss-Newton are both the
simplest and the fastest here. Node 0 is the anchor and stays at the identity.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from somfusion_ros.geometry import Array, between, between_jacobians, compose, inverse, wrap
from somfusion_ros.settings import tuned

MAX_ITERATIONS = 20


@dataclass(frozen=True)
class PoseGraphTuning:
    """When the solution is found, and what ties it."""

    least_freedom: float = tuned(
        1e-6, '', 'share of its own noise that a constraint keeps where others say the same; '
        'below, nobody else does', 'by design')
    step_tolerance: float = tuned(
        1e-9, 'm, rad', 'a smaller step is none; all robots must find the same poses', 'by design')
    rough_step: float = tuned(
        1e-3, 'm, rad', 'the last one while constraints are still left out; what remains after '
        'it changes chi-square by less than a ten-thousandth', 'triangles with one wrong pair')
    alike: float = tuned(
        5e-4, '', 'share of chi-square; constraints that differ by less are equally bad to leave '
        'in', 'triangles with one wrong pair')


TUNING = PoseGraphTuning()


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """
    Measured relative poses of nodes 0..nodes-1, all reachable from node 0.

    pairs (E, 2) node numbers (target, source), measured (E, 3) T_target_source, information
    (E, 3, 3) of its (x, y, theta).
    """

    nodes: int
    pairs: NDArray[np.intp]
    measured: Array
    information: Array

    def without(self, constraint: int) -> 'PoseGraph':
        """Leave one constraint out."""
        keep = np.arange(len(self.pairs)) != constraint
        return PoseGraph(self.nodes, self.pairs[keep], self.measured[keep], self.information[keep])

    @cached_property
    def links(self) -> 'Links':
        """The pairs of nodes that constraints join, each once."""
        numbers, number = np.unique(self.pairs @ [self.nodes, 1], return_inverse=True)
        a, b = np.divmod(numbers, self.nodes)
        place = np.concatenate([3 * a[:, None] + np.arange(3), 3 * b[:, None] + np.arange(3)], 1)
        order = np.argsort(number, kind='stable')
        first = np.searchsorted(number[order], np.arange(len(numbers)))
        node = np.arange(self.nodes)[:, None]
        return Links(a, b, number, order, first,
                     np.add.reduceat(self.information[order], first, axis=0), place,
                     ((node == a).astype(float), (node == b).astype(float)))


class Links(NamedTuple):
    """
    Pairs (L,) of nodes a, b that constraints join.

    number (E,): that of every constraint; order (E,): constraints by that number, and first (L,)
    of each in it; information (L, 3, 3): that of all constraints on a pair, whose residuals have
    the same Jacobian; place (L, 6): of this in the normal matrix; ends (nodes, L): 1 where a node
    is a, and where it is b.
    """

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    number: NDArray[np.intp]
    order: NDArray[np.intp]
    first: NDArray[np.intp]
    information: Array
    place: NDArray[np.intp]
    ends: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Estimate:
    """Poses (nodes, 3) in node 0's frame, normal matrix H (3 nodes, 3 nodes), chi-square (E,)."""

    poses: Array
    H: Array
    chi2: Array

    @cached_property
    def P(self) -> Array:
        """Covariance (3 nodes, 3 nodes) of all poses."""
        P = np.zeros_like(self.H)
        P[3:, 3:] = np.linalg.inv(self.H[3:, 3:])
        return P

    @property
    def covariances(self) -> Array:
        """Of every node's pose, (nodes, 3, 3)."""
        n = np.arange(len(self.poses))
        blocks: Array = self.P.reshape(len(n), 3, len(n), 3)[n, :, n, :]
        return blocks


def components(nodes: int, pairs: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the nodes of every connected group in rising order, the group of node 0 first."""
    a, b = pairs.reshape(-1, 2).T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    count, labels = connected_components(links, directed=False)
    groups = [np.flatnonzero(labels == label) for label in range(count)]
    return sorted(groups, key=lambda group: int(group[0]))


def optimise(graph: PoseGraph, start: Array | None = None,
             tolerance: float = TUNING.step_tolerance) -> Estimate:
    """
    Solve by Gauss-Newton, until a step is smaller than a tolerance [m, rad].

    From start (nodes, 3), or from the poses along a tree of the best-known constraints.
    """
    poses = _along_tree(graph) if start is None else start
    for _ in range(MAX_ITERATIONS):
        H, gradient = _linearise(graph, poses)
        step = np.zeros((graph.nodes, 3))
        step[1:] = -np.linalg.solve(H[3:, 3:], gradient[3:]).reshape(-1, 3)
        poses = poses + step
        poses[:, 2] = wrap(poses[:, 2])
        if np.abs(step).max() < tolerance:
            break
    residual = _residuals(graph, poses)      # H is as it was a step ago, which is within tolerance
    chi2 = np.einsum('ei,ei->e', residual, np.einsum('eij,ej->ei', graph.information, residual))
    return Estimate(poses, H, chi2)


def leave_one_out(graph: PoseGraph, estimate: Estimate) -> Array:
    """
    Return the chi-square (E,) that the others sum up to without each constraint, to first order.

    What a constraint's residual is in the scale of its own noise, less what the solution owes to
    it, is removed. inf where the graph would fall apart: such a constraint has no residual. Of
    those that cannot be the worst, which most are, it is a bound from above that is not the least.
    """
    links, P, total = graph.links, estimate.P, estimate.chi2.sum()
    J = np.concatenate(_jacobians(graph, estimate.poses), axis=-1)
    spread = J @ P[links.place[:, :, None], links.place[:, None, :]] @ np.swapaxes(J, 1, 2)
    owed = np.einsum('eij,eij->e', graph.information, spread[links.number])    # the trace
    most = np.where(owed < 1.0, estimate.chi2 / np.maximum(1.0 - owed, TUNING.least_freedom),
                    np.inf)
    without: Array = np.asarray(total - estimate.chi2)
    worst = np.flatnonzero(most >= estimate.chi2.max() - 1e-6 * total)
    without[worst] = total - _removed(graph, estimate.poses, spread, worst)
    return without


def _removed(graph: PoseGraph, poses: Array, spread: Array, which: NDArray[np.intp]) -> Array:
    """
    Return what chi-square (K,) loses with each of some constraints; -inf where nobody else ties.

    spread (L, 3, 3): covariance of what the constraints of each link measure.
    """
    root = np.linalg.cholesky(graph.information[which])
    white = np.einsum('eji,ej->ei', root, _residuals(graph, poses)[which])
    owed = np.swapaxes(root, 1, 2) @ spread[graph.links.number[which]] @ root
    free, directions = np.linalg.eigh(np.eye(3) - owed)
    along = np.einsum('eji,ej->ei', directions, white)
    tied = free > TUNING.least_freedom
    removed = np.sum(np.where(tied, along ** 2 / np.where(tied, free, 1.0), 0.0), axis=1)
    return np.where(tied.any(axis=1), removed, -np.inf)


def _linearise(graph: PoseGraph, poses: Array) -> tuple[Array, Array]:
    """Build the normal matrix H and the gradient at the given poses."""
    links, nodes = graph.links, np.arange(graph.nodes)
    weighted = np.einsum('eij,ej->ei', graph.information, _residuals(graph, poses))
    pull = np.add.reduceat(weighted[links.order], links.first, axis=0)
    by_a, by_b = _jacobians(graph, poses)
    H = np.zeros((graph.nodes, 3, graph.nodes, 3))
    ours, theirs = by_a.swapaxes(1, 2) @ links.information, by_b.swapaxes(1, 2) @ links.information
    H[links.a, :, links.b] = ours @ by_b
    H += H.transpose(2, 3, 0, 1)
    own = sum(end @ np.hstack([(JtW @ J).reshape(-1, 9), np.einsum('eji,ej->ei', J, pull)])
              for end, JtW, J in zip(links.ends, (ours, theirs), (by_a, by_b)))
    H[nodes, :, nodes] += own[:, :9].reshape(-1, 3, 3)
    return H.reshape(3 * graph.nodes, -1), own[:, 9:].ravel()


def _residuals(graph: PoseGraph, poses: Array) -> Array:
    """Return residuals (E, 3)."""
    links = graph.links
    residual = between(poses[links.a], poses[links.b])[links.number] - graph.measured
    residual[:, 2] = wrap(residual[:, 2])
    return residual


def _jacobians(graph: PoseGraph, poses: Array) -> tuple[Array, Array]:
    """Return the Jacobians (L, 3, 3) of what the constraints of each link measure."""
    return between_jacobians(poses[graph.links.a], poses[graph.links.b])


def _along_tree(graph: PoseGraph) -> Array:
    """Compose the measurements outward from node 0, best-known constraints first."""
    poses, placed = np.zeros((graph.nodes, 3)), np.arange(graph.nodes) == 0
    order = np.argsort(-np.linalg.det(graph.information), kind='stable')
    first, second = graph.pairs[order].T
    while not placed.all():
        leads_on = placed[first] != placed[second]
        if not leads_on.any():
            raise ValueError('the graph is not connected')
        constraint = order[leads_on.argmax()]
        a, b = graph.pairs[constraint]
        if placed[a]:
            poses[b] = compose(poses[a], graph.measured[constraint])
        else:
            poses[a] = compose(poses[b], inverse(graph.measured[constraint]))
        placed[[a, b]] = True
    return poses
