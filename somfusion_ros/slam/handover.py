# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The pose with which a robot goes on from another view: what a match fixes, and what was expected.

Along a corridor a match says nothing. What was known there before it must not be lost with the
view from which it was known: the robot would slide along the walls, and be sure across them only.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from somfusion_ros.geometry import Array, difference, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.matching import Match


@dataclass(frozen=True)
class HandoverTuning:
    """When a match alone tells the pose."""

    weaker: float = tuned(
        2.0, 'times', 'the sigma that was expected, which a match may have in its weakest '
        'direction and still tells the pose alone', 'by design')


TUNING = HandoverTuning()


def handed_over(match: Match, expected: Array, P: Array) -> tuple[Array, Array]:
    """
    Return the pose (3,) of a match and its covariance (3, 3), with what it does not fix.

    Where the match fixes every direction about as well as the expected pose (3,) with covariance
    P (3, 3) did, it stands alone, so that nothing is counted twice (Walter et al. 2007);
    otherwise both are fused (Kalman).
    """
    pose, R, P = match.T_map_scan, match.covariance, P + 1e-9 * np.eye(3)
    if eigh(R, P, eigvals_only=True)[-1] < TUNING.weaker ** 2:
        return pose, R
    K = P @ np.linalg.inv(P + R)
    fused = expected + K @ difference(pose, expected)
    fused[2] = wrap(fused[2])
    I_K = np.eye(3) - K
    return fused, I_K @ P @ I_K.T + K @ R @ K.T
