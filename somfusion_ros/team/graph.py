# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Accepted pairs make a graph; the graph places every connected robot's map in one world.

The world of a connected group is the map frame of its member whose name sorts first, so that
all robots that know the same pairs agree on it without a vote.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from scipy.special import chdtri
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.team.constraint import Dropped, MapConstraint, TUNING
from somfusion_ros.team.estimate import Estimate, optimise
from somfusion_ros.team.leaving_out import leave_one_out
from somfusion_ros.team.pair_words import PairWords
from somfusion_ros.team.pose_graph import components, PoseGraph
from somfusion_ros.team.pose_graph import TUNING as SOLVING
from somfusion_ros.team.rigid_groups import RigidGroups
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.voices import one_voice_each

NAMED = 8             # robots that a reason names
CONTRADICTIONS = 3    # of one author that are left out one by one; then all that it says is


def solve(robots: Iterable[str], constraints: Iterable[MapConstraint]) -> Solution:
    """
    Place every robot's map in the world of its connected group.

    What both robots of a pair say is solved first, and lies fast for what one says alone: no
    number of liars moves two robots that agree. Constraints that contradict the cycles they close
    are left out one by one, until noise and the drift of maps explain what remains (pairwise
    consistency, as in Kimera-Multi). Of an author whose constraints contradict again and again all
    is left out, so that the time is bounded.

    Parameters
    ----------
    robots : iterable of str
        Names; a robot without a constraint is a group of its own.
    constraints : iterable of MapConstraint
        Accepted pairs, several per pair allowed; every author has one voice per pair.

    Returns
    -------
    Solution
        Where every map lies, with covariances, and what was left out and why.

    Raises
    ------
    ValueError
        If a constraint names an unknown robot or is not finite.

    References
    ----------
    Y. Tian et al., "Kimera-Multi: Robust, distributed, dense metric-semantic SLAM for multi-robot
    systems", T-RO 2022.

    Examples
    --------
    >>> beside = [MapConstraint('a', 'b', Pose(2.0, 0.0, 0.0), np.eye(3)),
    ...           MapConstraint('b', 'c', Pose(1.0, 0.0, 0.0), np.eye(3))]
    >>> solution = solve(['a', 'b', 'c', 'd'], beside)
    >>> [sorted(group) for group in solution.groups]
    [['a', 'b', 'c'], ['d']]
    >>> round(solution.groups[0]['c'].x, 6)
    3.0
    """
    names = sorted(set(robots))
    voices, dropped = one_voice_each(constraints)
    words = PairWords.of(names, voices)
    both = words.both_say()
    agreed = _sorted_out(names, words.only(np.flatnonzero(both)), dropped)
    pieces, alone = RigidGroups(names, agreed), words.only(np.flatnonzero(~both))
    dropped += [*agreed.dropped, *pieces.against(alone)]
    joining = pieces.between(alone)
    placed = pieces.laid(_sorted_out(pieces.names, joining, dropped))
    wrong = {one.constraint for one in placed.dropped}
    return replace(placed, dropped=(*dropped, *placed.dropped),
                   pieces=tuple(frozenset(group) for group in agreed.groups),
                   single=tuple(one for one in joining.constraints if one not in wrong))


def _sorted_out(names: list[str], words: PairWords, before: Iterable[Dropped]) -> Solution:
    """Place all nodes by what is left of the words; before: what was dropped of these authors."""
    dropped: list[Dropped] = []
    doubts = Counter(one.constraint.author for one in before)
    near: dict[str, Pose] = {}
    while True:
        solution = _place(names, words, doubts + Counter(
            one.constraint.author for one in dropped), near)
        near = {name: pose for group in solution.groups for name, pose in group.items()}
        wrong = Counter(one.constraint.author for one in solution.dropped)
        liars = {author for author, count in wrong.items() if author and count > CONTRADICTIONS}
        if not liars:      # else what was dropped of others is looked at again
            return replace(solution, dropped=(*dropped, *solution.dropped))
        dropped += [Dropped(one, f'all that {one.author} says is left out: over '
                            f'{CONTRADICTIONS} of its pairs contradict the others')
                    for one in words.constraints if one.author in liars]
        words = words.only(np.flatnonzero([one.author not in liars
                                           for one in words.constraints]))


def _place(names: list[str], words: PairWords, wrong: Mapping[str, int],
           near: Mapping[str, Pose]) -> Solution:
    """
    Solve every connected group; stop leaving out where one author is wrong too often.

    wrong: how often each author has contradicted itself; near: where the maps lie about.
    """
    groups: list[dict[str, Pose]] = []
    covariances: dict[str, Array] = {}
    dropped: list[Dropped] = []
    for group in components(len(names), words.pairs) if names else ():
        members = [names[i] for i in group]
        inside = words.only(np.flatnonzero(np.isin(words.pairs[:, 0], group)))
        inside = inside._replace(pairs=np.searchsorted(group, inside.pairs))
        start = (np.array([between(near[members[0]], near[name]) for name in members])
                 if near else None)
        estimate, left_out = _consistent(members, inside, wrong, start)
        dropped += left_out
        groups.append({m: Pose.from_array(p) for m, p in zip(members, estimate.poses)})
        covariances |= dict(zip(members, estimate.covariances))
    groups.sort(key=lambda group: (-len(group), min(group)))
    return Solution(tuple(groups), covariances, tuple(dropped))


def _consistent(members: list[str], words: PairWords, doubts: Mapping[str, int],
                start: Array | None) -> tuple[Estimate, list[Dropped]]:
    """Solve one connected group, dropping constraints until the cycles agree."""
    graph = PoseGraph(len(members), words.pairs, words.measured,
                      words.information / words.times()[:, None, None])
    constraints, estimate = list(words.constraints), optimise(graph, start, SOLVING.rough_step)
    dropped: list[Dropped] = []
    doubted = Counter(doubts)
    while _contradicts(graph, estimate):
        worst = _worst_constraint(graph, constraints, estimate, doubted)
        wrong = constraints.pop(worst)
        doubted[wrong.author] += 1
        reason = (f'{wrong.target} - {wrong.source} ({wrong.kind}) contradicts the other accepted '
                  f'pairs: chi-square {estimate.chi2.sum():.1f} over {_gate(graph):.1f} among '
                  f'{", ".join(sorted(members)[:NAMED])}')
        dropped.append(Dropped(wrong, reason))
        graph = graph.without(worst)
        if sum(one.constraint.author == wrong.author != '' for one in dropped) > CONTRADICTIONS:
            return estimate, dropped   # all that this author says is going to be left out
        estimate = optimise(graph, estimate.poses, SOLVING.rough_step)
    return optimise(graph, estimate.poses), dropped


def _contradicts(graph: PoseGraph, estimate: Estimate) -> bool:
    """Return whether the cycles as a whole, or one constraint, are off by more than noise."""
    return len(graph.pairs) >= graph.nodes and bool(
        estimate.chi2.sum() > _gate(graph)
        or estimate.chi2.max(initial=0.0) > chdtri(3, 1.0 - TUNING.contradiction))


def _gate(graph: PoseGraph) -> float:
    """Return the chi-square that the cycles of a graph may sum up to."""
    freedom = 3 * (len(graph.pairs) - graph.nodes + 1)
    return float(chdtri(freedom, 1.0 - TUNING.contradiction)) if freedom else np.inf


def _worst_constraint(graph: PoseGraph, constraints: list[MapConstraint], estimate: Estimate,
                      doubted: Mapping[str, int]) -> int:
    """
    Find the constraint on a cycle without which the others agree best.

    In a single cycle all do equally well: there the word of the author goes that was wrong most
    often, then the least probable constraint, then the least known one.
    """
    without = leave_one_out(graph, estimate)
    alike = np.flatnonzero(without <= without.min() + SOLVING.alike * estimate.chi2.sum()).tolist()
    return min(alike, key=lambda number: (
        -doubted.get(constraints[number].author, 0), constraints[number].probability,
        float(np.linalg.det(graph.information[number]))))
