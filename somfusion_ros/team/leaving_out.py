# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How well a pose graph would fit without each of its constraints."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.team.estimate import Estimate
from somfusion_ros.team.pose_graph import PoseGraph, TUNING


def leave_one_out(graph: PoseGraph, estimate: Estimate) -> Array:
    """
    Return the chi-square (E,) that the others sum up to without each constraint, to first order.

    What a constraint's residual is in the scale of its own noise, less what the solution owes to
    it, is removed. inf where the graph would fall apart: such a constraint has no residual. Of
    those that cannot be the worst, which most are, it is a bound from above that is not the least.
    """
    links, P, total = graph.links, estimate.P, estimate.chi2.sum()
    J = np.concatenate(graph.jacobians(estimate.poses), axis=-1)
    spread = J @ P[links.place[:, :, None], links.place[:, None, :]] @ np.swapaxes(J, 1, 2)
    owed = np.einsum('eij,eij->e', graph.information, spread[links.number])    # the trace
    most = np.where(owed < 1.0, estimate.chi2 / np.maximum(1.0 - owed, TUNING.least_freedom),
                    np.inf)
    without: Array = np.asarray(total - estimate.chi2)
    worst = np.flatnonzero(most >= estimate.chi2.max() - 1e-6 * total)
    without[worst] = total - _removed(graph, estimate.poses, spread, worst)
    without[graph.bridges] = np.inf
    return without


def _removed(graph: PoseGraph, poses: Array, spread: Array, which: NDArray[np.intp]) -> Array:
    """
    Return what chi-square (K,) loses with each of some constraints; -inf where nobody else ties.

    spread (L, 3, 3): covariance of what the constraints of each link measure.
    """
    root = np.linalg.cholesky(graph.information[which])
    white = np.einsum('eji,ej->ei', root, graph.residuals(poses)[which])
    owed = np.swapaxes(root, 1, 2) @ spread[graph.links.number[which]] @ root
    free, directions = np.linalg.eigh(np.eye(3) - owed)
    along = np.einsum('eji,ej->ei', directions, white)
    tied = free > TUNING.least_freedom
    removed = np.sum(np.where(tied, along ** 2 / np.where(tied, free, 1.0), 0.0), axis=1)
    return np.where(tied.any(axis=1), removed, -np.inf)
