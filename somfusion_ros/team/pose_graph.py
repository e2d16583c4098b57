# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A few poses that are tied by measured relative poses.

Node 0 is the anchor and stays at the identity.
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


@dataclass(frozen=True)
class PoseGraphTuning:
    """When the solution is found, and what ties it."""

    least_freedom: float = tuned(
        1e-6, '', 'share of its own noise that a constraint keeps where others say the same; '
        'below, nobody else does', 'by design')
    step_tolerance: float = tuned(
        1e-9, 'm, rad', 'a smaller step is none; all robots must find the same poses', 'by design')
    rounding: float = tuned(
        1e-12, '', 'share of its diagonal that is added to the normal matrix, so that rounding '
        'never makes it singular', 'by design')
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
    def bridges(self) -> NDArray[np.bool_]:
        """
        Which constraints (E,) the graph would fall apart without, however far apart its poses are.

        Those whose ends have the effective resistance of the constraint itself, where all have 1.
        """
        a, b = self.pairs.T
        G = np.zeros((self.nodes, self.nodes))
        np.add.at(G, (self.pairs, self.pairs), 1.0)
        np.subtract.at(G, (self.pairs, self.pairs[:, ::-1]), 1.0)
        G[1:, 1:] = np.linalg.inv(G[1:, 1:])    # whole numbers, and connected: never near singular
        G[0], G[:, 0] = 0.0, 0.0
        return np.asarray(G[a, a] + G[b, b] - 2.0 * G[a, b] > 1.0 - 0.5 / self.nodes)

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

    def residuals(self, poses: Array) -> Array:
        """Return by how much poses (nodes, 3) miss what was measured, (E, 3)."""
        links = self.links
        residual = between(poses[links.a], poses[links.b])[links.number] - self.measured
        residual[:, 2] = wrap(residual[:, 2])
        return residual

    def jacobians(self, poses: Array) -> tuple[Array, Array]:
        """Return the Jacobians (L, 3, 3) of what the constraints of each link measure."""
        return between_jacobians(poses[self.links.a], poses[self.links.b])

    def along_tree(self) -> Array:
        """Compose the measurements outward from node 0, best-known constraints first."""
        poses, placed = np.zeros((self.nodes, 3)), np.arange(self.nodes) == 0
        order = np.argsort(-np.linalg.det(self.information), kind='stable')
        first, second = self.pairs[order].T
        while not placed.all():
            leads_on = placed[first] != placed[second]
            if not leads_on.any():
                raise ValueError('the graph is not connected')
            constraint = order[leads_on.argmax()]
            a, b = self.pairs[constraint]
            if placed[a]:
                poses[b] = compose(poses[a], self.measured[constraint])
            else:
                poses[a] = compose(poses[b], inverse(self.measured[constraint]))
            placed[[a, b]] = True
        return poses


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


def components(nodes: int, pairs: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the nodes of every connected group in rising order, the group of node 0 first."""
    a, b = pairs.reshape(-1, 2).T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    count, labels = connected_components(links, directed=False)
    groups = [np.flatnonzero(labels == label) for label in range(count)]
    return sorted(groups, key=lambda group: int(group[0]))
