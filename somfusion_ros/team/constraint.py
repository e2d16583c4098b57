# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot says about two maps: where one lies in the other, and how well that is known."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import Array, inverse, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch


@dataclass(frozen=True)
class ConstraintTuning:
    """How well two maps can be tied at all, and what nobody can claim."""

    drift_sigma_xy: float = tuned(
        0.2, 'm', 'two maps of one place bend apart by this much, so that no constraint is better '
        'known; smaller calls bent maps a contradiction, larger lets wrong pairs pass',
        'benchmarks/team/accuracy.py on mines, wean, Intel and CSAIL')
    drift_sigma_theta: float = tuned(
        float(np.radians(1.0)), 'rad', 'the same for the heading; it is felt as translation over '
        'the distance of the two origins as well',
        'benchmarks/team/accuracy.py on mines, wean, Intel and CSAIL')
    contradiction: float = tuned(
        0.999, '', 'chance with which noise alone stays below the gate of chi-square; nearer to 1 '
        'leaves less out', 'by design')
    most_sigma_xy: float = tuned(
        1e3, 'm', 'a constraint known worse than this says nothing', 'by design')
    most_sigma_theta: float = tuned(
        10.0, 'rad', 'the same for the heading', 'by design')
    least_independence: float = tuned(
        1e-9, '', 'least eigenvalue of a matrix of correlations; nearer to singular, rounding '
        'decides', 'by design')


TUNING = ConstraintTuning()


@dataclass(frozen=True, eq=False)
class MapConstraint:
    """
    A relative pose of two robots' maps, as one robot accepted it.

    covariance (3, 3) of (x, y, theta) [m, rad] in the target frame; probability of being right,
    which decides between constraints that contradict each other equally well; kind: match,
    sighting, or known where the user gave it; epochs of the target's and the source's map, while
    which it counts; author: the robot that says it.
    """

    target: str
    source: str
    T_target_source: Pose
    covariance: Array
    probability: float = 1.0
    kind: str = 'match'
    epochs: tuple[Epoch, Epoch] = (Epoch(), Epoch())
    author: str = ''

    @property
    def robots(self) -> tuple[str, str]:
        """Names of the two robots."""
        return self.target, self.source


@dataclass(frozen=True, eq=False)
class Dropped:
    """A constraint that contradicts others, and a sentence why."""

    constraint: MapConstraint
    reason: str


def turned(constraint: MapConstraint) -> MapConstraint:
    """Return the same as seen from the other map: T_source_target with its covariance."""
    P, T = constraint.covariance, Pose.from_array(inverse(constraint.T_target_source))
    c, s = np.cos(constraint.T_target_source.theta), np.sin(constraint.T_target_source.theta)
    J = np.array([[-c, -s, T.y], [s, -c, -T.x], [0.0, 0.0, -1.0]])
    return replace(constraint, target=constraint.source, source=constraint.target,
                   T_target_source=T, covariance=J @ P @ J.T, epochs=constraint.epochs[::-1])


def with_drift(T_target_source: ArrayLike, covariance: Array) -> Array:
    """Add to constraints' covariances (..., 3, 3) how much two maps of one place bend apart."""
    pose = np.asarray(T_target_source, dtype=float)
    length = np.hypot(pose[..., 0], pose[..., 1])
    sigma_xy = np.hypot(TUNING.drift_sigma_xy, TUNING.drift_sigma_theta * length)
    drifted = np.array(covariance, dtype=float)
    for k, sigma in enumerate((sigma_xy, sigma_xy, TUNING.drift_sigma_theta)):
        drifted[..., k, k] += sigma ** 2
    return drifted


def sane_covariance(covariance: Array) -> Array:
    """
    Return a covariance (3, 3) of (x, y, theta) that somebody claims, if it can be one.

    ValueError unless it is symmetric, positive definite, and no sigma is absurd.
    """
    P = np.asarray(covariance, dtype=float)
    if P.shape != (3, 3) or not np.isfinite(P).all() or not (
            np.abs(P - P.T) <= TUNING.least_independence * np.abs(P)).all():
        raise ValueError('covariance is no symmetric matrix of finite numbers')
    variances = np.diag(P)
    most = np.array([TUNING.most_sigma_xy, TUNING.most_sigma_xy, TUNING.most_sigma_theta]) ** 2
    if (variances <= 0.0).any() or (variances > most).any():
        raise ValueError(f'covariance has variances {variances.tolist()}')
    scale = 1.0 / np.sqrt(variances)
    if not np.linalg.eigvalsh(P * np.outer(scale, scale))[0] > TUNING.least_independence:
        raise ValueError('covariance is not positive definite')
    return P
