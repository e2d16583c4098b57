# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The whole estimate, solved again: Gauss-Newton over all kept constraints (relinearisation).

An EKF linearises each measurement once, where the mean then was. When a loop moves the poses
far, solving the sparse problem anew at the moved poses, and putting mean and covariance back in
the filter, takes that error out (Kaess et al. 2008).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from somfusion_ros.geometry import Array, between_jacobians, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.constraint import Constraint


@dataclass(frozen=True)
class SmoothingTuning:
    """How the whole problem is solved again."""

    robust: float = tuned(
        3.0, 'sigmas', 'beyond, loop residuals count less and less (Cauchy)', 'shared logs')
    converged: float = tuned(
        1e-4, 'm, rad', 'a smaller step ends the iteration', 'by design')


TUNING = SmoothingTuning()


class Problem:
    """All constraints between n views as arrays, ready for Gauss-Newton."""

    def __init__(self, constraints: Sequence[Constraint]) -> None:
        self.i = np.array([r.first for r in constraints])
        self.j = np.array([r.second for r in constraints])
        self.z = np.array([r.z for r in constraints])
        self.Omega = np.linalg.inv(np.array([r.R for r in constraints]))
        self.loop = np.ones(len(self.j), bool)      # all but the first of each view
        self.loop[np.unique(self.j, return_index=True)[1]] = False

    def residuals(self, x: Array) -> tuple[Array, Array]:
        """Return z - h(x) (m, 3) and robust weights (m,)."""
        e = self.z - _between(x[self.i], x[self.j])
        e[:, 2] = wrap(e[:, 2])
        chi2 = np.einsum('ma,mab,mb->m', e, self.Omega, e)
        return e, np.where(self.loop, 1.0 / (1.0 + chi2 / TUNING.robust ** 2), 1.0)

    def normal_equations(self, x: Array, robust: bool = True) -> tuple[csc_matrix, Array]:
        """Return the information matrix (3 n, 3 n) and gradient (3 n,), view 0 held fixed."""
        e, w = self.residuals(x)
        w = w if robust else np.ones_like(w)
        A, B = between_jacobians(x[self.i], x[self.j])
        weighted = self.Omega * w[:, None, None]
        AtO, BtO = A.transpose(0, 2, 1) @ weighted, B.transpose(0, 2, 1) @ weighted
        n = len(x)
        g = np.zeros((n, 3))
        np.add.at(g, self.i, (AtO @ e[:, :, None])[:, :, 0])
        np.add.at(g, self.j, (BtO @ e[:, :, None])[:, :, 0])
        AB = AtO @ B
        blocks = np.concatenate([AtO @ A, AB, AB.transpose(0, 2, 1), BtO @ B,
                                 1e12 * np.eye(3)[None]])
        rows = np.concatenate([self.i, self.i, self.j, self.j, [0]])
        columns = np.concatenate([self.i, self.j, self.i, self.j, [0]])
        r = (3 * rows[:, None, None] + np.arange(3)[None, :, None]).repeat(3, 2)
        c = (3 * columns[:, None, None] + np.arange(3)[None, None, :]).repeat(3, 1)
        shape = (3 * n, 3 * n)
        return csc_matrix((blocks.ravel(), (r.ravel(), c.ravel())), shape=shape), g.ravel()


def solve(poses: Array, constraints: Sequence[Constraint], iterations: int = 8) -> Array:
    """Re-solve view poses (n, 3) from constraints, starting at the given poses."""
    x, problem = np.array(poses, dtype=float), Problem(constraints)
    for _ in range(iterations):
        H, g = problem.normal_equations(x)
        step = splu(H, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                    options={'SymmetricMode': True}).solve(g).reshape(-1, 3)
        x += step
        x[:, 2] = wrap(x[:, 2])
        if np.abs(step).max() < TUNING.converged:
            break
    return x


def covariance(poses: Array, constraints: Sequence[Constraint]) -> Array:
    """
    Return P (3 n, 3 n) of solved view poses; only its lower triangle is valid.

    Every constraint counts in full, as in the filter that goes on with P after a restart.
    """
    H, _ = Problem(constraints).normal_equations(np.asarray(poses, dtype=float), robust=False)
    factor, info = dpotrf(H.toarray(order='F'), lower=1, overwrite_a=1)
    if info:
        raise np.linalg.LinAlgError('the constraints do not fix every view')
    inverse: Array = dpotri(factor, lower=1, overwrite_c=1)[0]
    return inverse


def _between(a: Array, b: Array) -> Array:
    """Return the poses (m, 3) of b in a, row by row, without wrapping the angle."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    d = b - a
    return np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]])
