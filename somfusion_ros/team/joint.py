# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team's problem: every robot's constraints and those between robots, solved together.

The problem is that of `slam.smoothing`, over the thinned nodes of all robots. Constraints of a
robot's own and between robots count less and less the worse they fit (Cauchy's kernel). Those
between robots start with a wide kernel that narrows (graduated non-convexity, Yang et al. 2020):
bent maps miss one another by far more than a match is unsure of, and only the solution shows
which matches are wrong. The same facts give the same solution, to the bit, on every robot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix, identity
from scipy.sparse.linalg import splu
from somfusion_ros.geometry import Array, compose, inverse, Pose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.team.thinning import hung, Spine
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
    converged: float = tuned(1e-5, 'm, rad', 'of the last step', 'by design')
    held: float = tuned(1e12, '', 'information that holds the first node where it is',
                        'by design')
    damping: float = tuned(1e-3, '', 'information of a first node of every other robot, where '
                           'matches leave a direction open', 'by design')
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


@dataclass(frozen=True, eq=False)
class JointSolution:
    """
    Where all views lie in the world.

    poses (n, 3) T_world_view by robot, and per match its squared Mahalanobis distance.
    """

    poses: dict[str, Array]
    chi2: Array

    def T_world_map(self, robot: str, own: Array) -> Pose:
        """Return where a robot's map lies so that its last view, at poses (n, 3), is right."""
        last = min(len(own), len(self.poses[robot])) - 1
        return Pose.from_array(compose(self.poses[robot][last], inverse(own[last])))


def solve_joint(robots: Mapping[str, ViewSet], matches: Sequence[InterMatch],
                T_world_map: Mapping[str, Array], settings: JointSettings | None = None
                ) -> JointSolution:
    """
    Solve the constraints of a connected group of robots.

    Parameters
    ----------
    robots : their views and constraints; the first view of the first robot by name stays where
        it is
    matches : constraints between robots
    T_world_map : (3,) by robot, where each robot's map lies about
    settings : how to solve it
    """
    settings = settings or JointSettings()
    names = sorted(robots)
    total = sum(len(robots[name]) for name in names)
    every = max(settings.every, -(-total // settings.nodes))
    spines = {name: Spine(robots[name].steps, every) for name in names}
    first: dict[str, int] = {}
    start: list[Array] = []
    for name in names:
        first[name] = sum(len(part) for part in start)
        nodes = robots[name].poses[spines[name].nodes]
        start.append(compose(np.asarray(T_world_map[name]), nodes))
    problem = _Problem(settings)
    for name in names:
        problem.add_robot(robots[name], spines[name], first[name])
    problem.add_matches(matches, spines, first)
    x = problem.solve(np.concatenate(start))
    poses = {name: spines[name].follow(x[first[name]:first[name] + len(spines[name].nodes)])
             for name in names}
    return JointSolution(poses, problem.chi2(x)[len(problem.kernel) - len(matches):])


class _Problem:
    """Constraints between nodes as arrays, ready for Gauss-Newton."""

    def __init__(self, settings: JointSettings) -> None:
        self._settings = settings
        self._constraints: list[Constraint] = []
        self.kernel: list[str] = []
        self._first_nodes: list[int] = []

    def add_robot(self, views: ViewSet, spine: Spine, first: int) -> None:
        """Add a robot's steps and loops; its nodes are numbered from `first`."""
        loops = [hung(r, spine, spine) for r in views.loops]
        loops = [r for r in loops if r.first != r.second]
        self._first_nodes.append(first)
        for relation, kind in [*((r, 'step') for r in spine.links),
                               *((r, 'loop') for r in loops)]:
            self._add(relation, first, first, kind)

    def add_matches(self, matches: Sequence[InterMatch], spines: Mapping[str, Spine],
                    first: Mapping[str, int]) -> None:
        """Add constraints between robots, last of all."""
        floor = self._settings.floor_covariance
        for m in matches:
            relation = hung(Constraint(m.target_view, m.source_view, m.z, m.R + floor),
                            spines[m.target], spines[m.source])
            self._add(relation, first[m.target], first[m.source], 'match')

    def _add(self, r: Constraint, first: int, second: int, kind: str) -> None:
        """Add a constraint between nodes numbered from `first` and from `second`."""
        self._constraints.append(Constraint(first + r.first, second + r.second, r.z, r.R))
        self.kernel.append(kind)

    def _arrays(self) -> None:
        """Put the constraints into arrays."""
        self._i = np.array([r.first for r in self._constraints])
        self._j = np.array([r.second for r in self._constraints])
        self._z = np.array([r.z for r in self._constraints])
        R = np.array([r.R for r in self._constraints])
        self._Omega = np.linalg.inv(R + 1e-12 * np.eye(3))
        self._firsts = np.array(self._first_nodes)
        self._damping = np.tile(self._settings.damping * np.eye(3), (len(self._firsts), 1, 1))
        self._damping[0] = self._settings.held * np.eye(3)
        kinds = np.array(self.kernel)
        self._match, self._robust = kinds == 'match', kinds != 'step'

    def solve(self, x: Array) -> Array:
        """Find the poses (n, 3) of all nodes from where they are about."""
        self._arrays()
        settings, width = self._settings, self._settings.widest
        for _ in range(settings.iterations):
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
        A, B = _jacobians(x[self._i], x[self._j])
        AtO, BtO = A.transpose(0, 2, 1) @ weighted, B.transpose(0, 2, 1) @ weighted
        g = np.zeros((len(x), 3))
        np.add.at(g, self._i, (AtO @ e[:, :, None])[:, :, 0])
        np.add.at(g, self._j, (BtO @ e[:, :, None])[:, :, 0])
        AB = AtO @ B
        i, j = self._i, self._j
        H = _sparse([(i, i, AtO @ A), (i, j, AB), (j, i, AB.transpose(0, 2, 1)), (j, j, BtO @ B),
                     (self._firsts, self._firsts, self._damping)], len(x))
        try:
            step = _solved(H, g)
        except RuntimeError:     # singular to the last digit: hold every node where it is a little
            step = _solved(H + self._settings.damping * identity(3 * len(x), format='csc'), g)
        return step


def _solved(H: csc_matrix, g: Array) -> Array:
    """Step (n, 3) for a gradient (n, 3); RuntimeError where the problem is singular."""
    factor = splu(csc_matrix(H), permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                  options={'SymmetricMode': True})
    step: Array = factor.solve(g.ravel()).reshape(-1, 3)
    return step


def _sparse(blocks: list[tuple[Array, Array, Array]], nodes: int) -> csc_matrix:
    """Sum blocks (m, 3, 3) at rows and columns (m,) of nodes into one matrix."""
    values = np.concatenate([block for _, _, block in blocks])
    rows = np.concatenate([row for row, _, _ in blocks])
    columns = np.concatenate([column for _, column, _ in blocks])
    r = (3 * rows[:, None, None] + np.arange(3)[None, :, None]).repeat(3, 2)
    c = (3 * columns[:, None, None] + np.arange(3)[None, None, :]).repeat(3, 1)
    return csc_matrix((values.ravel(), (r.ravel(), c.ravel())), shape=(3 * nodes, 3 * nodes))


def _jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the Jacobians (m, 3, 3) of the pose of b in a, in a and in b, row by row."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    d = b - a
    B = np.zeros((len(a), 3, 3))
    B[:, 0, 0], B[:, 0, 1], B[:, 1, 0], B[:, 1, 1], B[:, 2, 2] = c, s, -s, c, 1.0
    A = -B
    A[:, 0, 2] = -s * d[:, 0] + c * d[:, 1]
    A[:, 1, 2] = -c * d[:, 0] - s * d[:, 1]
    return A, B
