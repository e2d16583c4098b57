# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Accepted pairs make a graph; the graph places every connected robot's map in one world.

The world of a connected group is the map frame of its member whose name sorts first, so that
all robots that know the same pairs agree on it without a vote.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.team.pose_graph import chi2_from, component, Estimate, Graph, optimise

# Two maps of one place bend differently, so an edge is never better known than this.
DRIFT_SIGMA_XY = 0.2                # [m]
DRIFT_SIGMA_THETA = np.radians(1.0)  # [rad], also felt as translation over the edge's length
CONTRADICTION = 0.999               # chance with which noise alone stays below the gate
SUSPECTS = 12                       # edges of the largest residuals that are tried for leaving out


@dataclass(frozen=True, eq=False)
class Edge:
    """
    An accepted relative pose of two robots' maps.

    covariance (3, 3) of (x, y, theta) in the target frame; probability of being right, which
    decides between edges that contradict each other equally well; kind: match or sighting.
    """

    target: str
    source: str
    T_target_source: Pose
    covariance: Array
    probability: float = 1.0
    kind: str = 'match'

    @property
    def robots(self) -> tuple[str, str]:
        """Names of the two robots."""
        return self.target, self.source


@dataclass(frozen=True, eq=False)
class Dropped:
    """An edge that contradicts the others, and a sentence why."""

    edge: Edge
    reason: str


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Where every robot's map lies.

    groups: per connected group T_world_map by robot, the largest first; covariances (3, 3) of
    those poses by robot; edges that were dropped.
    """

    groups: tuple[dict[str, Pose], ...]
    covariances: dict[str, Array]
    dropped: tuple[Dropped, ...] = ()

    def group_of(self, robot: str) -> dict[str, Pose]:
        """T_world_map by robot of the group that holds a robot."""
        return next((group for group in self.groups if robot in group), {robot: Pose()})


def solve(robots: Iterable[str], edges: Iterable[Edge]) -> Solution:
    """
    Place every robot's map in the world of its connected group.

    Edges that contradict the cycles they close are left out one by one, until noise and the
    drift of maps explain what remains (pairwise consistency, as in Kimera-Multi).

    Parameters
    ----------
    robots : names; a robot without an edge is a group of its own
    edges : accepted pairs, several per pair allowed
    """
    names, kept = sorted(set(robots)), sorted(edges, key=lambda e: (e.target, e.source))
    _check(names, kept)
    groups, covariances, dropped, left = [], {}, [], list(names)
    while left:
        pairs = _numbered(names, kept)
        members = [names[i] for i in component(len(names), pairs, names.index(left[0]))]
        inside = [edge for edge in kept if edge.target in members]
        estimate, wrong = _consistent(members, inside)
        dropped += wrong
        groups.append({m: Pose.from_array(p) for m, p in zip(members, estimate.poses)})
        covariances |= dict(zip(members, estimate.covariances))
        left = [name for name in left if name not in members]
    groups.sort(key=lambda group: (-len(group), min(group)))
    return Solution(tuple(groups), covariances, tuple(dropped))


def with_drift(T_target_source: Pose, covariance: Array) -> Array:
    """Add to an edge's covariance (3, 3) how much two maps of one place bend apart."""
    length = np.hypot(T_target_source.x, T_target_source.y)
    sigma_xy = np.hypot(DRIFT_SIGMA_XY, DRIFT_SIGMA_THETA * length)
    return covariance + np.diag([sigma_xy, sigma_xy, DRIFT_SIGMA_THETA]) ** 2


def _check(names: list[str], edges: list[Edge]) -> None:
    """Raise ValueError on edges that no graph can hold."""
    for edge in edges:
        if edge.target == edge.source or not {edge.target, edge.source} <= set(names):
            raise ValueError(f'edge {edge.target} - {edge.source} does not join two robots of '
                             f'{names}')
        if not (np.isfinite(edge.covariance).all() and np.isfinite(edge.T_target_source).all()):
            raise ValueError(f'edge {edge.target} - {edge.source} is not finite')


def _numbered(names: list[str], edges: list[Edge]) -> Array:
    """Node numbers (E, 2) of edges."""
    return np.array([(names.index(e.target), names.index(e.source)) for e in edges],
                    dtype=np.intp).reshape(-1, 2)


def _consistent(members: list[str], edges: list[Edge]) -> tuple[Estimate, list[Dropped]]:
    """Solve one connected group, dropping edges until the cycles agree."""
    graph = Graph(len(members), _numbered(members, edges),
                  np.array([e.T_target_source for e in edges]).reshape(-1, 3),
                  _information(edges))
    edges, dropped, estimate = list(edges), [], optimise(graph)
    while _contradicts(graph, estimate):
        worst = _worst_edge(graph, edges, estimate)
        wrong = edges.pop(worst)
        reason = (f'{wrong.target} - {wrong.source} ({wrong.kind}) contradicts the other accepted '
                  f'pairs: chi-square {estimate.chi2.sum():.1f} over {_gate(graph):.1f} among '
                  f'{", ".join(members)}')
        dropped.append(Dropped(wrong, reason))
        graph = graph.without(worst)
        estimate = optimise(graph)
    return estimate, dropped


def _information(edges: list[Edge]) -> Array:
    """
    Information (E, 3, 3) of edges; those of one kind between the same two maps count as one.

    Both robots of a pair match the same walls, and sightings hang on the same poses: their errors
    are the same, so they are averaged as in covariance intersection with equal weights.
    """
    alike = Counter((frozenset(edge.robots), edge.kind) for edge in edges)
    return np.array([np.linalg.inv(with_drift(edge.T_target_source, edge.covariance))
                     / alike[frozenset(edge.robots), edge.kind]
                     for edge in edges]).reshape(-1, 3, 3)


def _contradicts(graph: Graph, estimate: Estimate) -> bool:
    """Tell whether the cycles as a whole, or one edge among many, are off by more than noise."""
    return bool(estimate.chi2.sum() > _gate(graph)
                or estimate.chi2.max(initial=0.0) > chdtri(3, 1.0 - CONTRADICTION))


def _gate(graph: Graph) -> float:
    """Chi-square that the cycles of a graph may sum up to."""
    freedom = 3 * (len(graph.pairs) - graph.nodes + 1)
    return float(chdtri(freedom, 1.0 - CONTRADICTION)) if freedom else np.inf


def _worst_edge(graph: Graph, edges: list[Edge], estimate: Estimate) -> int:
    """
    Find the edge on a cycle without which the others agree best.

    In a single cycle all do equally well: there the least probable edge goes, then the least
    known one. A wrong edge pulls at its own cycles, so it is sought where the residuals are large.
    """
    def cost(edge: int) -> tuple[float, float, float]:
        rest = graph.without(edge)
        if len(component(graph.nodes, rest.pairs, 0)) < graph.nodes:
            return np.inf, 0.0, 0.0  # a bridge lies on no cycle
        return (round(chi2_from(rest, estimate.poses), 3), edges[edge].probability,
                float(np.linalg.det(graph.information[edge])))
    suspects = np.argsort(-estimate.chi2, kind='stable')[:SUSPECTS]
    return int(min(sorted(suspects), key=cost))
