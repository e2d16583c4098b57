# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least squares over a few poses that are tied by measured relative poses.

A team has at most some tens of robots, so dense matrices and plain Gauss-Newton are both the
simplest and the fastest here. Node 0 is the anchor and stays at the identity.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import Array, between, between_jacobians, compose, inverse, wrap

MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-10


class Graph(NamedTuple):
    """
    Measured relative poses of nodes 0..nodes-1, all reachable from node 0.

    pairs (E, 2) node numbers (target, source), measured (E, 3) T_target_source, information
    (E, 3, 3) of its (x, y, theta).
    """

    nodes: int
    pairs: NDArray[np.intp]
    measured: Array
    information: Array

    def without(self, edge: int) -> 'Graph':
        """Leave one edge out."""
        keep = np.arange(len(self.pairs)) != edge
        return Graph(self.nodes, self.pairs[keep], self.measured[keep], self.information[keep])


class Estimate(NamedTuple):
    """Poses (nodes, 3) in node 0's frame, covariances (nodes, 3, 3), chi-square per edge (E,)."""

    poses: Array
    covariances: Array
    chi2: Array


def component(nodes: int, pairs: NDArray[np.intp], start: int) -> list[int]:
    """Nodes that edges connect to a start node, in rising order."""
    found, frontier = {start}, [start]
    while frontier:
        here = frontier.pop()
        for a, b in pairs:
            other = b if a == here else a if b == here else here
            if other not in found:
                found.add(int(other))
                frontier.append(int(other))
    return sorted(found)


def optimise(graph: Graph) -> Estimate:
    """Gauss-Newton from the poses along a tree of the best-known edges."""
    poses = _along_tree(graph)
    for _ in range(MAX_ITERATIONS):
        H, gradient, _ = _linearise(graph, poses)
        step = np.zeros(3 * graph.nodes)
        step[3:] = -np.linalg.solve(H[3:, 3:], gradient[3:])
        poses = poses + step.reshape(-1, 3)
        poses[:, 2] = wrap(poses[:, 2])
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    H, _, chi2 = _linearise(graph, poses)
    P = np.zeros((3 * graph.nodes, 3 * graph.nodes))
    P[3:, 3:] = np.linalg.inv(H[3:, 3:])
    blocks = np.arange(graph.nodes)
    covariances = P.reshape(graph.nodes, 3, graph.nodes, 3)[blocks, :, blocks, :]
    return Estimate(poses, covariances, chi2)


def _linearise(graph: Graph, poses: Array) -> tuple[Array, Array, Array]:
    """Build the normal matrix H, gradient, and chi-square per edge at the given poses."""
    H = np.zeros((3 * graph.nodes, 3 * graph.nodes))
    gradient = np.zeros(3 * graph.nodes)
    chi2 = np.zeros(len(graph.pairs))
    for edge, (a, b) in enumerate(graph.pairs):
        residual = between(poses[a], poses[b]) - graph.measured[edge]
        residual[2] = wrap(residual[2])
        J = np.hstack(between_jacobians(poses[a], poses[b]))
        JtW = J.T @ graph.information[edge]
        index = np.r_[3 * a:3 * a + 3, 3 * b:3 * b + 3]
        H[np.ix_(index, index)] += JtW @ J
        gradient[index] += JtW @ residual
        chi2[edge] = residual @ graph.information[edge] @ residual
    return H, gradient, chi2


def _along_tree(graph: Graph) -> Array:
    """Compose the measurements outward from node 0, best-known edges first."""
    poses, placed = np.zeros((graph.nodes, 3)), {0}
    order = np.argsort(-np.linalg.det(graph.information), kind='stable')
    while len(placed) < graph.nodes:
        for edge in order:
            a, b = (int(node) for node in graph.pairs[edge])
            if (a in placed) == (b in placed):
                continue
            if a in placed:
                poses[b] = compose(poses[a], graph.measured[edge])
            else:
                poses[a] = compose(poses[b], inverse(graph.measured[edge]))
            placed |= {a, b}
            break
        else:
            raise ValueError('the graph is not connected')
    return poses
