# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot says about two maps: where one lies in the other, and how well that is known."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class MapConstraint:
    """
    A relative pose of two robots' maps, as one robot accepted it.

    covariance (3, 3) of (x, y, theta) [m, rad] in the target frame; probability of being right,
    which decides between constraints that contradict each other equally well; kind: match or
    sighting.
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
