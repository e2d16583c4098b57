# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Constraints between the nodes of all robots, and Gauss-Newton on them.

The problem is that of `slam.smoothing`. Constraints of a robot's own and between robots count less
and less the worse they fit (Cauchy's kernel). Those between robots start with a wide kernel that
narrows (graduated non-convexity, Yang et al. 2020): bent maps miss one another by far more than a
match is unsure of, and only the solution shows which matches are wrong.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix, diags, identity
from scipy.sparse.linalg import splu
from somfusion_ros.geometry import Array, between_jacobians, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.team.constraint import information_of
from somfusion_ros.team.thinning import Constraints, hung, Spine
from somfusion_ros.team.view_set import ViewSet


@dataclass(frozen=True)
class JointSettings:
    """How the team's problem is solved."""

    every: int = tuned(8, 'views', 'per node; the chain between keeps its information',
                       'shared teams: 1, 4 and 8 differ by less than 0.01 of the walls')
    nodes: int = tuned(2500, 'nodes', 'of all robots at most, in 0.3 s; more views are thinned '
                       'more', 'simulated teams')
    kernel: float = tuned(3.0, 'sigma', 'from which a constraint counts less', 'as for loops')
    widest: float = tuned(100.0, 'sigma', 'with which the kernel between robots starts: maps '
                          'that are bent by metres miss by so much', 'shared teams')
    narrowing: float = tuned(0.5, '', 'of that kernel per iteration', 'not measured')
    iterations: int = tuned(20, 'steps', 'at most; ten are usual', 'shared teams')
    warm_iterations: int = tuned(2, 'steps', 'at most, from the solution of a little less',
                                 'simulated teams')
    converged: float = tuned(1e-5, 'm, rad', 'of the last step', 'by design')
    held: float = tuned(1e12, '', 'information that holds the first node where it is',
                        'by design')
    damping: float = tuned(1e-3, '', 'information of a first node of every other robot, where '
                           'matches leave a direction open', 'by design')
    farthest_step: float = tuned(1e4, 'm', 'that a node moves at once; whole steps run away from '
                                 'what is absurd', 'by design')
    floor: tuple[float, float] = tuned((0.01, 0.01), 'm, rad', 'least sigma between robots, so '
                                       'that no claim of one bends the others', 'shared teams')

    @property
    def floor_covariance(self) -> Array:
        """Covariance (3, 3) that every match between robots has besides its own."""
        x, theta = self.floor
        return np.diag([x, x, theta]) ** 2


@dataclass(frozen=True, eq=False)
class InterMatch:
    """A measured pose z (3,) of a source robot's view in a target robot's view, with its R."""

    target: str
    target_view: int
    source: str
    source_view: int
    z: Array
    R: Array


class JointProblem:
    """Constraints between nodes, ready for Gauss-Newton; firsts: the robots' first nodes."""

    def __init__(self, settings: JointSettings, firsts: list[int]) -> None:
        self._settings = settings
        self._firsts = np.array(firsts)
        self._damping = np.tile(settings.damping * np.eye(3), (len(firsts), 1, 1))
        self._damping[0] = settings.held * np.eye(3)
        self._parts: list[tuple[Constraints, bool, bool]] = []    # robust, between robots

    def add_robot(self, views: ViewSet, spine: Spine, first: int) -> None:
        """Add a robot's steps and loops; its nodes are numbered from `first`."""
        self._add(spine.links, first, first, False, False)
        loops = hung(Constraints.of(views.loops), spine, spine)
        apart = loops.first != loops.second
        self._add(Constraints(*(part[apart] for part in loops)), first, first, True, False)

    def add_matches(self, matches: Sequence[InterMatch], spines: Mapping[str, Spine],
                    first: Mapping[str, int]) -> Array:
        """Add constraints between robots; return where each stands among all."""
        floor, at = self._settings.floor_covariance, sum(len(p.z) for p, _, _ in self._parts)
        pairs: dict[tuple[str, str], list[int]] = {}
        for k, m in enumerate(matches):
            pairs.setdefault((m.target, m.source), []).append(k)
        for (target, source), group in sorted(pairs.items()):
            them = [matches[k] for k in group]
            told = Constraints(
                np.array([m.target_view for m in them]), np.array([m.source_view for m in them]),
                np.array([m.z for m in them]), np.array([m.R for m in them]) + floor)
            self._add(hung(told, spines[target], spines[source]), first[target], first[source],
                      True, True)
        order = [k for _, group in sorted(pairs.items()) for k in group]
        return at + np.argsort(np.array(order, int))

    def _add(self, c: Constraints, first: int, second: int, robust: bool, match: bool) -> None:
        """Add constraints between nodes numbered from `first` and from `second`."""
        moved = Constraints(c.first + first, c.second + second, c.z, c.R)
        self._parts.append((moved, robust, match))

    def _arrays(self) -> None:
        """Put all constraints together."""
        parts = [part for part, _, _ in self._parts]
        self._i, self._j, self._z, R = map(np.concatenate, zip(*parts, strict=True))
        self._Omega = information_of(R + 1e-12 * np.eye(3))
        counts = [len(part.z) for part in parts]
        self._robust = np.repeat([robust for _, robust, _ in self._parts], counts)
        self._match = np.repeat([match for _, _, match in self._parts], counts)

    def solve(self, x: Array, warm: bool) -> Array:
        """Find the poses (n, 3) of all nodes from where they are about, or nearly, if warm."""
        self._arrays()
        settings = self._settings
        width = settings.kernel if warm else settings.widest
        for _ in range(settings.warm_iterations if warm else settings.iterations):
            step = self._step(x, width)
            x = x + step
            x[:, 2] = wrap(x[:, 2])
            if width <= settings.kernel and np.abs(step).max() < settings.converged:
                break
            width = max(settings.kernel, settings.narrowing * width)
        return x

    def chi2(self, x: Array) -> Array:
        """Return the squared Mahalanobis distances (m,) at poses (n, 3)."""
        e = self._residuals(x)
        distances: Array = np.einsum('ma,mab,mb->m', e, self._Omega, e)
        return distances

    def _residuals(self, x: Array) -> Array:
        """Return measured minus expected (m, 3)."""
        a, b = x[self._i], x[self._j]
        c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
        d = b - a
        e: Array = self._z - np.column_stack([
            c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]])
        e[:, 2] = wrap(e[:, 2])
        return e

    def _step(self, x: Array, width: float) -> Array:
        """Return one step (n, 3) of Gauss-Newton with the robust weights at x."""
        e = self._residuals(x)
        chi2 = np.einsum('ma,mab,mb->m', e, self._Omega, e)
        scale = np.where(self._match, width, self._settings.kernel) ** 2
        weight = np.where(self._robust, 1.0 / (1.0 + chi2 / scale), 1.0)
        weighted = self._Omega * weight[:, None, None]
        A, B = between_jacobians(x[self._i], x[self._j])
        AtO, BtO = A.transpose(0, 2, 1) @ weighted, B.transpose(0, 2, 1) @ weighted
        g = np.zeros((len(x), 3))
        np.add.at(g, self._i, (AtO @ e[:, :, None])[:, :, 0])
        np.add.at(g, self._j, (BtO @ e[:, :, None])[:, :, 0])
        AB = AtO @ B
        i, j = self._i, self._j
        H = _sparse([(i, i, AtO @ A), (i, j, AB), (j, i, AB.transpose(0, 2, 1)), (j, j, BtO @ B),
                     (self._firsts, self._firsts, self._damping)], len(x))
        step = _solved(H, g)
        if step is None:     # singular to the last digit: hold every node where it is a little
            held = self._settings.damping * (identity(3 * len(x)) + diags(H.diagonal()))
            step = _solved(H + held, g)
        return np.zeros_like(x) if step is None else np.clip(
            step, -self._settings.farthest_step, self._settings.farthest_step)


def _solved(H: csc_matrix, g: Array) -> Array | None:
    """Step (n, 3) for a gradient (n, 3); None where the problem is singular."""
    try:
        factor = splu(csc_matrix(H), permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                      options={'SymmetricMode': True})
    except RuntimeError:
        return None
    step: Array = factor.solve(g.ravel()).reshape(-1, 3)
    return step if np.isfinite(step).all() else None


def _sparse(blocks: list[tuple[Array, Array, Array]], nodes: int) -> csc_matrix:
    """Sum blocks (m, 3, 3) at rows and columns (m,) of nodes into one matrix."""
    values = np.concatenate([block for _, _, block in blocks])
    rows = np.concatenate([row for row, _, _ in blocks])
    columns = np.concatenate([column for _, column, _ in blocks])
    r = (3 * rows[:, None, None] + np.arange(3)[None, :, None]).repeat(3, 2)
    c = (3 * columns[:, None, None] + np.arange(3)[None, None, :]).repeat(3, 1)
    return csc_matrix((values.ravel(), (r.ravel(), c.ravel())), shape=(3 * nodes, 3 * nodes))
