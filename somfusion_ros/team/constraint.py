# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot says about two maps: where one lies in the other, and how well that is known."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import Array, compose, compose_jacobians, inverse, Pose
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
    least_sigma: float = tuned(
        1e-9, 'm, rad', 'nobody knows anything better', 'by design')
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
    J = inverse_jacobian(constraint.T_target_source)
    return replace(constraint, target=constraint.source, source=constraint.target,
                   T_target_source=T, covariance=J @ P @ J.T, epochs=constraint.epochs[::-1])


def chained(own: tuple[ArrayLike, Array], between: tuple[ArrayLike, Array],
            peer: tuple[ArrayLike, Array]) -> tuple[Pose, Array]:
    """
    Return T_own_peer of two frames and its covariance (3, 3).

    own: T_own_a, between: T_a_b, peer: T_peer_b, each with its covariance (3, 3).
    """
    T_own_b = compose(own[0], between[0])
    by_own, by_between = compose_jacobians(own[0], between[0])
    P = by_own @ own[1] @ by_own.T + by_between @ between[1] @ by_between.T
    T_b_peer = inverse(peer[0])
    by_first, by_second = compose_jacobians(T_own_b, T_b_peer)
    turned = by_second @ inverse_jacobian(peer[0])
    P = by_first @ P @ by_first.T + turned @ peer[1] @ turned.T
    return Pose.from_array(compose(T_own_b, T_b_peer)), (P + P.T) / 2.0


def inverse_jacobian(T_a_b: ArrayLike) -> Array:
    """Return the Jacobian (3, 3) of `inverse`."""
    x, y, theta = np.asarray(T_a_b, dtype=float).tolist()
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[-c, -s, x * s - y * c], [s, -c, x * c + y * s], [0.0, 0.0, -1.0]])


def information_of(covariance: Array) -> Array:
    """
    Return the inverse of covariances (..., 3, 3); also of those that rounding left singular.

    Seen from the other map, what is not known of a heading is what is not known of a place far
    away, and what is known well is lost in it.
    """
    P = np.asarray(covariance, dtype=float)
    variances = np.einsum('...ii->...i', P)
    scale = 1.0 / np.sqrt(np.maximum(variances, TUNING.least_sigma ** 2))
    scale = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh((P + np.swapaxes(P, -1, -2)) / 2.0 * scale)
    values = np.maximum(values, TUNING.least_independence * values[..., -1:])
    information: Array = np.einsum('...ik,...k,...jk->...ij', vectors, 1.0 / values,
                                   vectors) * scale
    return information


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
    if (variances < TUNING.least_sigma ** 2).any() or (variances > most).any():
        raise ValueError(f'covariance has variances {variances.tolist()}')
    scale = 1.0 / np.sqrt(variances)
    if not np.linalg.eigvalsh(P * np.outer(scale, scale))[0] > TUNING.least_independence:
        raise ValueError('covariance is not positive definite')
    return P
