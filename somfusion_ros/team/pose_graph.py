# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least squares over a few poses that are tied by measured relative poses.

A team has at most some tens of robots, so dense matrices and plain Gauss-Newton are both the
simplest and the fastest here. Node 0 is the anchor and stays at the identity.
"""

from dataclasses import dataclass
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


TUNING = PoseGraphTuning()


class PoseGraph(NamedTuple):
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


class Estimate(NamedTuple):
    """Poses (nodes, 3) in node 0's frame, covariances (nodes, 3, 3), chi-square (E,)."""

    poses: Array
    covariances: Array
    chi2: Array


def component(nodes: int, pairs: NDArray[np.intp], start: int) -> list[int]:
    """Return the nodes that constraints connect to a start node, in rising order."""
    a, b = pairs.reshape(-1, 2).T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    labels = connected_components(links, directed=False)[1]
    return np.flatnonzero(labels == labels[start]).tolist()


def optimise(graph: PoseGraph) -> Estimate:
    """Solve by Gauss-Newton, from the poses along a tree of the best-known constraints."""
    poses = _along_tree(graph)
    for _ in range(MAX_ITERATIONS):
        poses, step = _step(graph, poses)
        if step < TUNING.step_tolerance:
            break
    H, _, chi2 = _linearise(graph, poses)
    P = np.zeros((3 * graph.nodes, 3 * graph.nodes))
    P[3:, 3:] = np.linalg.inv(H[3:, 3:])
    blocks = np.arange(graph.nodes)
    covariances = P.reshape(graph.nodes, 3, graph.nodes, 3)[blocks, :, blocks, :]
    return Estimate(poses, covariances, chi2)


def leave_one_out(graph: PoseGraph, estimate: Estimate) -> Array:
    """
    Return the chi-square (E,) that the others sum up to without each constraint, to first order.

    What a constraint's residual is in the scale of its own noise, less what the solution owes to
    it, is removed. inf where the graph would fall apart: such a constraint has no residual.
    """
    H, _, chi2 = _linearise(graph, estimate.poses)
    P = np.zeros_like(H)
    P[3:, 3:] = np.linalg.inv(H[3:, 3:])
    residual, J, index = _residuals(graph, estimate.poses)
    root = np.linalg.cholesky(graph.information)
    white = np.einsum('eji,ej->ei', root, residual)
    J = np.swapaxes(root, 1, 2) @ J
    owed = J @ P[index[:, :, None], index[:, None, :]] @ np.swapaxes(J, 1, 2)
    free, directions = np.linalg.eigh(np.eye(3) - owed)
    along = np.einsum('eji,ej->ei', directions, white)
    tied = free > TUNING.least_freedom
    removed = np.sum(np.where(tied, along ** 2 / np.where(tied, free, 1.0), 0.0), axis=1)
    without: Array = np.where(tied.any(axis=1), chi2.sum() - removed, np.inf)
    return without


def _step(graph: PoseGraph, poses: Array) -> tuple[Array, float]:
    """Do one step of Gauss-Newton: new poses and the size of the step."""
    H, gradient, _ = _linearise(graph, poses)
    step = np.zeros(3 * graph.nodes)
    step[3:] = -np.linalg.solve(H[3:, 3:], gradient[3:])
    poses = poses + step.reshape(-1, 3)
    poses[:, 2] = wrap(poses[:, 2])
    return poses, float(np.abs(step).max())


def _linearise(graph: PoseGraph, poses: Array) -> tuple[Array, Array, Array]:
    """Build the normal matrix H, gradient, and chi-square per constraint at the given poses."""
    residual, J, index = _residuals(graph, poses)
    JtW = np.swapaxes(J, 1, 2) @ graph.information
    size = 3 * graph.nodes
    H = np.bincount((size * index[:, :, None] + index[:, None, :]).ravel(), (JtW @ J).ravel(),
                    size * size).reshape(size, size)
    gradient = np.bincount(index.ravel(), np.einsum('eij,ej->ei', JtW, residual).ravel(), size)
    chi2 = np.einsum('ei,eij,ej->e', residual, graph.information, residual)
    return H, gradient, chi2


def _residuals(graph: PoseGraph, poses: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return residuals (E, 3), their Jacobians (E, 3, 6), and the places (E, 6) of these in H."""
    a, b = graph.pairs.T
    residual = between(poses[a], poses[b]) - graph.measured
    residual[:, 2] = wrap(residual[:, 2])
    J = np.concatenate(between_jacobians(poses[a], poses[b]), axis=-1)
    index = np.concatenate([3 * a[:, None] + np.arange(3), 3 * b[:, None] + np.arange(3)], 1)
    return residual, J, index


def _along_tree(graph: PoseGraph) -> Array:
    """Compose the measurements outward from node 0, best-known constraints first."""
    poses, placed = np.zeros((graph.nodes, 3)), np.arange(graph.nodes) == 0
    order = np.argsort(-np.linalg.det(graph.information), kind='stable')
    while not placed.all():
        leads_on = placed[graph.pairs[order]].sum(1) == 1
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
