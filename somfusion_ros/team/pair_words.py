# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of pairs of maps, one voice each, as arrays that a solver takes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri
from somfusion_ros.geometry import Array, wrap
from somfusion_ros.team.constraint import (information_of, MapConstraint, TUNING, turned,
                                           with_drift)


class PairWords(NamedTuple):
    """
    What is said, one voice each.

    robots (E, 2): numbers of the robots; pairs (E, 2): of the nodes that are tied, which are the
    same unless robots are taken together; measured (E, 3): poses of the nodes; information
    (E, 3, 3) of each, drift of the maps included.
    """

    constraints: list[MapConstraint]
    robots: NDArray[np.intp]
    pairs: NDArray[np.intp]
    measured: Array
    information: Array

    @classmethod
    def of(cls, names: Sequence[str], constraints: list[MapConstraint]) -> 'PairWords':
        """
        Return what constraints say of robots; ValueError on what no graph can hold.

        Each joins two of the names, and all its numbers are finite.
        """
        number = {name: k for k, name in enumerate(names)}
        for c in constraints:
            if c.target == c.source or not {*c.robots} <= number.keys():
                raise ValueError(f'constraint {" - ".join(c.robots)} does not join two robots of '
                                 f'{names}')
        poses, P = poses_of(constraints), covariances_of(constraints)
        finite = np.isfinite(poses).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
        if not finite.all():
            wrong = constraints[int(finite.argmin())]
            raise ValueError(f'constraint {" - ".join(wrong.robots)} is not finite')
        pairs = np.array([(number[c.target], number[c.source]) for c in constraints],
                         dtype=np.intp).reshape(-1, 2)
        return cls(constraints, pairs, pairs, poses, information_of(with_drift(poses, P)))

    def only(self, which: NDArray[np.intp]) -> 'PairWords':
        """Return some of them."""
        return PairWords([self.constraints[k] for k in which], *(part[which] for part in self[1:]))

    def times(self) -> NDArray[np.intp]:
        """
        Return how many words (E,) are of the same two robots and kind; together they count as one.

        Both robots of a pair match the same walls, and sightings hang on the same poses: their
        errors are the same, so they are averaged as in covariance intersection with equal weights.
        """
        number = {kind: k for k, kind in enumerate(sorted({c.kind for c in self.constraints}))}
        low, high = np.sort(self.robots, axis=1).T
        pair = low * (self.robots.max(initial=0) + 1) + high
        kinds = np.array([number[c.kind] for c in self.constraints], dtype=np.intp)
        same, counts = np.unique(pair * len(number) + kinds, return_inverse=True,
                                 return_counts=True)[1:]
        return np.asarray(counts[same])

    def both_say(self) -> NDArray[np.bool_]:
        """Return which words (E,) the other robot of the pair says as well, or the user said."""
        said = np.array([not c.author for c in self.constraints], bool)
        by = {(*c.robots, c.author): k for k, c in enumerate(self.constraints)}
        twice = []
        for k, c in enumerate(self.constraints):
            other = c.source if c.author == c.target else c.target
            back = by.get((c.target, c.source, other), by.get((c.source, c.target, other)))
            if back is not None and c.author in c.robots and k < back:
                twice.append((k, back))
        if twice:
            first, second = np.array(twice).T
            agree = agreeing(self.only(first).constraints, self.only(second).constraints)
            said[first[agree]] = said[second[agree]] = True
        return said


def agreeing(ones: Sequence[MapConstraint], others: Sequence[MapConstraint]) -> NDArray[np.bool_]:
    """Return which words (N,) on pairs agree with others, as noise and drift of maps allow."""
    others = [other if one.target == other.target else turned(other)
              for one, other in zip(ones, others, strict=True)]
    off = poses_of(ones) - poses_of(others)
    off[:, 2] = wrap(off[:, 2])
    P = with_drift(poses_of(ones), covariances_of(ones)) + covariances_of(others)
    chi2 = np.einsum('ni,ni->n', off, np.linalg.solve(P, off[..., None])[..., 0])
    return np.asarray(chi2 <= chdtri(3, 1.0 - TUNING.contradiction), bool)


def poses_of(constraints: Sequence[MapConstraint]) -> Array:
    """Return the poses (E, 3) of constraints."""
    return np.array([c.T_target_source for c in constraints], float).reshape(-1, 3)


def covariances_of(constraints: Sequence[MapConstraint]) -> Array:
    """Return the covariances (E, 3, 3) of constraints."""
    return np.concatenate([np.zeros((0, 3)), *(c.covariance for c in constraints)]
                          ).reshape(-1, 3, 3)
