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
from numpy.typing import NDArray
from scipy.special import chdtri
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.pose_graph import chi2_from, component, Estimate, optimise, PoseGraph

SUSPECTS = 12      # constraints of the largest residuals that are tried for leaving out


@dataclass(frozen=True)
class GraphTuning:
    """What explains a disagreement between maps."""

    drift_sigma_xy: float = tuned(
        0.2, 'm', 'two maps of one place bend apart by this much, so that no constraint is better '
        'known; smaller calls bent maps a contradiction, larger lets wrong pairs pass',
        'benchmarks/team/network.py on mines, wean, Intel and CSAIL')
    drift_sigma_theta: float = tuned(
        float(np.radians(1.0)), 'rad', 'the same for the heading; it is felt as translation over '
        'the distance of the two origins as well',
        'benchmarks/team/network.py on mines, wean, Intel and CSAIL')
    contradiction: float = tuned(
        0.999, '', 'chance with which noise alone stays below the gate of chi-square; nearer to 1 '
        'leaves less out', 'by design')


TUNING = GraphTuning()


@dataclass(frozen=True, eq=False)
class Dropped:
    """A constraint that contradicts the others, and a sentence why."""

    constraint: MapConstraint
    reason: str


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Where every robot's map lies.

    groups: per connected group T_world_map by robot, the largest first; covariances (3, 3) of
    those poses by robot; constraints that were dropped.
    """

    groups: tuple[dict[str, Pose], ...]
    covariances: dict[str, Array]
    dropped: tuple[Dropped, ...] = ()

    def group_of(self, robot: str) -> dict[str, Pose]:
        """T_world_map by robot of the group that holds a robot."""
        return next((group for group in self.groups if robot in group), {robot: Pose()})


def solve(robots: Iterable[str], constraints: Iterable[MapConstraint]) -> Solution:
    """
    Place every robot's map in the world of its connected group.

    Constraints that contradict the cycles they close are left out one by one, until noise and the
    drift of maps explain what remains (pairwise consistency, as in Kimera-Multi).

    Parameters
    ----------
    robots : names; a robot without a constraint is a group of its own
    constraints : accepted pairs, several per pair allowed
    """
    names, kept = sorted(set(robots)), sorted(constraints, key=lambda e: (e.target, e.source))
    _check(names, kept)
    groups: list[dict[str, Pose]] = []
    covariances: dict[str, Array] = {}
    dropped: list[Dropped] = []
    left = list(names)
    while left:
        pairs = _numbered(names, kept)
        members = [names[i] for i in component(len(names), pairs, names.index(left[0]))]
        inside = [c for c in kept if c.target in members]
        estimate, wrong = _consistent(members, inside)
        dropped += wrong
        groups.append({m: Pose.from_array(p) for m, p in zip(members, estimate.poses)})
        covariances |= dict(zip(members, estimate.covariances))
        left = [name for name in left if name not in members]
    groups.sort(key=lambda group: (-len(group), min(group)))
    return Solution(tuple(groups), covariances, tuple(dropped))


def with_drift(T_target_source: Pose, covariance: Array) -> Array:
    """Add to a constraint's covariance (3, 3) how much two maps of one place bend apart."""
    length = np.hypot(T_target_source.x, T_target_source.y)
    sigma_xy = np.hypot(TUNING.drift_sigma_xy, TUNING.drift_sigma_theta * length)
    drift: Array = np.diag([sigma_xy, sigma_xy, TUNING.drift_sigma_theta]) ** 2
    return covariance + drift


def _check(names: list[str], constraints: list[MapConstraint]) -> None:
    """Raise ValueError on constraints that no graph can hold."""
    for constraint in constraints:
        pair = ' - '.join(constraint.robots)
        if constraint.target == constraint.source or not {*constraint.robots} <= set(names):
            raise ValueError(f'constraint {pair} does not join two robots of {names}')
        if not (np.isfinite(constraint.covariance).all()
                and np.isfinite(constraint.T_target_source).all()):
            raise ValueError(f'constraint {pair} is not finite')


def _numbered(names: list[str], constraints: list[MapConstraint]) -> NDArray[np.intp]:
    """Node numbers (E, 2) of constraints."""
    return np.array([(names.index(e.target), names.index(e.source)) for e in constraints],
                    dtype=np.intp).reshape(-1, 2)


def _consistent(members: list[str],
                constraints: list[MapConstraint]) -> tuple[Estimate, list[Dropped]]:
    """Solve one connected group, dropping constraints until the cycles agree."""
    graph = PoseGraph(len(members), _numbered(members, constraints),
                      np.array([c.T_target_source for c in constraints]).reshape(-1, 3),
                      _information(constraints))
    constraints, estimate = list(constraints), optimise(graph)
    dropped: list[Dropped] = []
    while _contradicts(graph, estimate):
        worst = _worst_constraint(graph, constraints, estimate)
        wrong = constraints.pop(worst)
        reason = (f'{wrong.target} - {wrong.source} ({wrong.kind}) contradicts the other accepted '
                  f'pairs: chi-square {estimate.chi2.sum():.1f} over {_gate(graph):.1f} among '
                  f'{", ".join(members)}')
        dropped.append(Dropped(wrong, reason))
        graph = graph.without(worst)
        estimate = optimise(graph)
    return estimate, dropped


def _information(constraints: list[MapConstraint]) -> Array:
    """
    Information (E, 3, 3) of constraints; those of one kind between the same two maps count as one.

    Both robots of a pair match the same walls, and sightings hang on the same poses: their errors
    are the same, so they are averaged as in covariance intersection with equal weights.
    """
    alike = Counter((frozenset(c.robots), c.kind) for c in constraints)
    return np.array([np.linalg.inv(with_drift(c.T_target_source, c.covariance))
                     / alike[frozenset(c.robots), c.kind]
                     for c in constraints]).reshape(-1, 3, 3)


def _contradicts(graph: PoseGraph, estimate: Estimate) -> bool:
    """Return whether the cycles as a whole, or one constraint, are off by more than noise."""
    return bool(estimate.chi2.sum() > _gate(graph)
                or estimate.chi2.max(initial=0.0) > chdtri(3, 1.0 - TUNING.contradiction))


def _gate(graph: PoseGraph) -> float:
    """Chi-square that the cycles of a graph may sum up to."""
    freedom = 3 * (len(graph.pairs) - graph.nodes + 1)
    return float(chdtri(freedom, 1.0 - TUNING.contradiction)) if freedom else np.inf


def _worst_constraint(graph: PoseGraph, constraints: list[MapConstraint],
                      estimate: Estimate) -> int:
    """
    Find the constraint on a cycle without which the others agree best.

    In a single cycle all do equally well: there the least probable constraint goes, then the least
    known one. A wrong one pulls at its own cycles, so it is sought where the residuals are large.
    """
    def cost(number: int) -> tuple[float, float, float]:
        rest = graph.without(number)
        if len(component(graph.nodes, rest.pairs, 0)) < graph.nodes:
            return np.inf, 0.0, 0.0  # a bridge lies on no cycle
        return (round(chi2_from(rest, estimate.poses), 3), constraints[number].probability,
                float(np.linalg.det(graph.information[number])))
    suspects: list[int] = np.argsort(-estimate.chi2, kind='stable')[:SUSPECTS].tolist()
    return min(sorted(suspects), key=cost)
