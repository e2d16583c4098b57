# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the poses of a graph lie, by least squares.

A team has at most some tens of robots, so dense matrices and Gauss-Newton are both the simplest
and the fastest here.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from somfusion_ros.geometry import Array, wrap
from somfusion_ros.team.pose_graph import PoseGraph, TUNING

MAX_ITERATIONS = 20
HALVINGS = 12       # of a step that makes matters worse, before it is given up


@dataclass(frozen=True, eq=False)
class Estimate:
    """Poses (nodes, 3) in node 0's frame, normal matrix H (3 nodes, 3 nodes), chi-square (E,)."""

    poses: Array
    H: Array
    chi2: Array

    @cached_property
    def P(self) -> Array:
        """Covariance (3 nodes, 3 nodes) of all poses."""
        P, (even, scale) = np.zeros_like(self.H), _even(self.H[3:, 3:])
        P[3:, 3:] = np.linalg.inv(even) * np.outer(scale, scale)
        return P

    @property
    def covariances(self) -> Array:
        """Of every node's pose, (nodes, 3, 3)."""
        n = np.arange(len(self.poses))
        blocks: Array = self.P.reshape(len(n), 3, len(n), 3)[n, :, n, :]
        return blocks


def optimise(graph: PoseGraph, start: Array | None = None,
             tolerance: float = TUNING.step_tolerance) -> Estimate:
    """
    Solve by Gauss-Newton, until a step is smaller than a tolerance [m, rad].

    From start (nodes, 3), or from the poses along a tree of the best-known constraints, which
    fit exactly where no cycle is closed. A step is halved until it fits no worse than before:
    contradictions throw whole steps ever farther away.
    """
    open_ended = len(graph.pairs) < graph.nodes
    poses = graph.along_tree() if start is None or open_ended else start
    residual, chi2 = _misfit(graph, poses)
    for _ in range(MAX_ITERATIONS):
        H, gradient = _linearise(graph, poses, residual)
        even, scale = _even(H[3:, 3:])
        step = np.zeros((graph.nodes, 3))
        step[1:] = -(scale * np.linalg.solve(even, scale * gradient[3:])).reshape(-1, 3)
        for _ in range(HALVINGS):
            tried = poses + step
            tried[:, 2] = wrap(tried[:, 2])
            residual, after = _misfit(graph, tried)
            if after.sum() <= (1.0 + TUNING.step_tolerance) * chi2.sum() + TUNING.step_tolerance:
                break
            step = step / 2.0
        else:
            break
        poses, chi2 = tried, after
        if np.abs(step).max() < tolerance:
            break
    return Estimate(poses, H, chi2)      # H is as it was a step ago, which is within tolerance


def _even(H: Array) -> tuple[Array, Array]:
    """Return a normal matrix with ones on its diagonal, never singular, and the scale (n,)."""
    scale = 1.0 / np.sqrt(np.diag(H))
    return H * np.outer(scale, scale) + TUNING.rounding * np.eye(len(H)), scale


def _misfit(graph: PoseGraph, poses: Array) -> tuple[Array, Array]:
    """Return residuals (E, 3) and their chi-square (E,)."""
    residual = graph.residuals(poses)
    return residual, np.einsum('ei,ei->e', residual,
                               np.einsum('eij,ej->ei', graph.information, residual))


def _linearise(graph: PoseGraph, poses: Array, residual: Array) -> tuple[Array, Array]:
    """Build the normal matrix H and the gradient at poses with these residuals (E, 3)."""
    links, nodes = graph.links, np.arange(graph.nodes)
    weighted = np.einsum('eij,ej->ei', graph.information, residual)
    pull = np.add.reduceat(weighted[links.order], links.first, axis=0)
    by_a, by_b = graph.jacobians(poses)
    H = np.zeros((graph.nodes, 3, graph.nodes, 3))
    ours, theirs = by_a.swapaxes(1, 2) @ links.information, by_b.swapaxes(1, 2) @ links.information
    H[links.a, :, links.b] = ours @ by_b
    H += H.transpose(2, 3, 0, 1)
    own = sum(end @ np.hstack([(JtW @ J).reshape(-1, 9), np.einsum('eji,ej->ei', J, pull)])
              for end, JtW, J in zip(links.ends, (ours, theirs), (by_a, by_b)))
    H[nodes, :, nodes] += own[:, :9].reshape(-1, 3, 3)
    return H.reshape(3 * graph.nodes, -1), own[:, 9:].ravel()
