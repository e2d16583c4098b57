# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Groups of maps that lie fast, so that what one robot says alone places each as a whole.

However many liars agree on where two robots lie, these two say something else of one another, both
of them. So the words that both robots of a pair say are solved by themselves, and what they place
is a rigid group, which the words of single robots can lay anywhere, but not bend or tear.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri
from somfusion_ros.geometry import Array, between, compose, compose_jacobians, Pose, wrap
from somfusion_ros.team.constraint import chained, Dropped, information_of, TUNING
from somfusion_ros.team.pair_words import PairWords
from somfusion_ros.team.solution import Solution


class RigidGroups:
    """What is solved, as pieces; each has the name of its first robot, and lies in its frame."""

    def __init__(self, names: Sequence[str], solution: Solution) -> None:
        self._solution = solution
        self.names = sorted(min(group) for group in solution.groups)
        number = {name: k for k, name in enumerate(self.names)}
        self._group = {robot: number[min(group)] for group in solution.groups for robot in group}
        self._of = np.array([self._group[robot] for robot in names], dtype=np.intp)
        pose = {robot: one for group in solution.groups for robot, one in group.items()}
        self._poses = np.array([pose[robot] for robot in names]).reshape(-1, 3)
        self._P = np.array([solution.covariances[robot] for robot in names]).reshape(-1, 3, 3)

    def between(self, words: PairWords) -> PairWords:
        """Return what words say of two groups: of these, where one lies in the other."""
        pairs = self._of[words.robots]
        words = words._replace(pairs=pairs).only(np.flatnonzero(pairs[:, 0] != pairs[:, 1]))
        pieces = np.bincount(self._of)
        carried = [
            (one, info) if pieces[[i, j]].max() == 1 else self._carried(k, one, info)
            for (i, j), k, one, info in zip(words.pairs, words.robots, words.measured,
                                            words.information, strict=True)]
        measured, information = zip(*carried, strict=True) if carried else ((), ())
        return words._replace(measured=np.array(measured).reshape(-1, 3),
                              information=np.array(information).reshape(-1, 3, 3))

    def _carried(self, robots: NDArray[np.intp], measured: Array, information: Array
                 ) -> tuple[Array, Array]:
        """Return where one group lies in another, if one robot's map lies so in another's."""
        a, b = robots
        T, P = chained((self._poses[a], self._P[a]), (measured, information_of(information)),
                       (self._poses[b], self._P[b]))
        return np.array(T), information_of(P)

    def against(self, words: PairWords) -> list[Dropped]:
        """Return words on two robots of one group that contradict where these lie."""
        inside = words.only(np.flatnonzero(np.diff(self._of[words.robots], axis=1)[:, 0] == 0))
        a, b = inside.robots.T
        off = between(self._poses[a], self._poses[b]) - inside.measured
        off[:, 2] = wrap(off[:, 2])
        chi2 = np.einsum('ni,nij,nj->n', off, inside.information, off)
        return [Dropped(one, f'{one.target} - {one.source} ({one.kind}), which {one.author} says '
                        'alone, contradicts pairs of which both robots say the same')
                for one, much in zip(inside.constraints, chi2, strict=True)
                if much > chdtri(3, 1.0 - TUNING.contradiction)]

    def laid(self, placed: Solution) -> Solution:
        """
        Return where the robots lie, where their groups are placed.

        How the errors of a group's place and of a robot in it hang together is not known: the sum
        is no smaller than it is.
        """
        groups, covariances = [], {}
        for group in placed.groups:
            robots: dict[str, Pose] = {}
            for leader, pose in group.items():
                for robot, inner in self._solution.group_of(leader).items():
                    by_group, by_inner = compose_jacobians(pose, inner)
                    robots[robot] = pose if robot == leader else Pose.from_array(
                        compose(pose, inner))
                    covariances[robot] = (
                        by_group @ placed.covariances[leader] @ by_group.T
                        + by_inner @ self._solution.covariances[robot] @ by_inner.T)
            groups.append(dict(sorted(robots.items())))
        groups.sort(key=lambda group: (-len(group), min(group)))
        return Solution(tuple(groups), covariances, placed.dropped)
