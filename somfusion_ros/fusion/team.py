# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accepted pairs make a graph; the graph places every connected robot's map in one world."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array, Pose


@dataclass(frozen=True, eq=False)
class Edge:
    """An accepted relative pose of two robots' maps with its covariance (3, 3)."""

    target: str
    source: str
    T_target_source: Pose
    covariance: Array
