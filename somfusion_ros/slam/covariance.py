# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What keeps the filter honest: how errors of neighbouring matches hang together.

A match places the scan in what ten views saw. Some of its error is the scan's own and is gone
with the next scan; a part is handed on to the views after it, and adds up. A scale that the
odometry does not know adds up too, step by step with the same sign, wherever the surface does not
tell how far the robot went.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, rotation
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class CovarianceTuning:
    """How errors of neighbouring matches hang together."""

    handed_on: float = tuned(
        0.47, 'share of the variance',
        'the views after a match inherit this of its error; a laser of 240 degrees and '
        '4 m would have more, one that sees far less', 'benchmarks/slam/covariance.py')
    sweep_noise: tuple[float, float, float] = tuned(
        (0.1, 0.1, 0.4), 'share of the motion',
        'motion during a sweep that the twist does not tell', 'benchmarks/slam/covariance.py')


TUNING = CovarianceTuning()


def turned(theta: float) -> Array:
    """Return (3, 3) that takes small pose errors into a frame turned by theta [rad]."""
    T = np.eye(3)
    T[:2, :2] = rotation(-theta)
    return T


def seen_turned(P: Array, theta: float) -> Array:
    """Return the covariance P (3, 3) of a pose in the axes of a frame turned by theta [rad]."""
    T = turned(theta)
    seen: Array = T @ P @ T.T
    return seen


def along(P: Array, theta: float) -> float:
    """Return the sigma [m] along a heading [rad] of a pose with covariance P (3, 3)."""
    u = rotation(theta)[:, 0]
    return float(np.sqrt(u @ P[:2, :2] @ u))


def sweep_covariance(sweep: float, twist: Array) -> Array:
    """
    Return the covariance (3, 3) of the motion from a sweep's [s] first beam to its mean.

    The twist (3,) is measured over a longer time, so a share of the motion is unknown; the noise
    of an increment, a random walk, would be most of so short a one.
    """
    return np.diag(np.array(TUNING.sweep_noise) * 0.5 * sweep * twist) ** 2


class ScaleError:
    """
    Derivative (3,) of the pose by the scale of the travel, which no surface has fixed lately.

    As a considered, not estimated, state of the filter (Schmidt 1966): it follows every
    prediction and correction, and its share of the covariance grows with the square of the way.
    """

    def __init__(self) -> None:
        self._J = np.zeros(3)
        self._known = np.zeros(3)      # the part that is in the covariance of the last view

    @property
    def derivatives(self) -> Array:
        """Array (2, 3) of J and the part of it that is known, as a tracker's state holds them."""
        return np.array([self._J, self._known])

    @derivatives.setter
    def derivatives(self, values: Array) -> None:
        """Go on from what a saved state holds."""
        self._J, self._known = values[0].copy(), values[1].copy()

    def predict(self, F: Array, G: Array, step: Array) -> None:
        """Follow a step (3,) of the odometry; F, G (3, 3) are the Jacobians of composing it."""
        self._J = F @ self._J + G[:, :2] @ step[:2]

    def correct(self, I_K: Array) -> None:
        """Follow a correction by I - K H (3, 3)."""
        self._J = I_K @ self._J

    def covariance(self, variance: float) -> Array:
        """Return what a scale of this variance adds (3, 3) since the last view."""
        added = variance * (np.outer(self._J, self._J) - np.outer(self._known, self._known))
        values, vectors = np.linalg.eigh(added)
        positive: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
        return positive

    def forget(self) -> None:
        """Begin anew where a match alone tells the pose."""
        self._J, self._known = np.zeros(3), np.zeros(3)

    def start_view(self, theta: float) -> None:
        """Go on in the frame of a new view, turned by theta [rad] from the last."""
        self._J = turned(theta) @ self._J
        self._known = self._J
