# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two maps in, their relative pose with a verdict out: the paper's pipeline in order."""

from dataclasses import dataclass, field

import numpy as np

from somfusion_ros.config import FusionConfig
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid


@dataclass(frozen=True)
class RunnerUp:
    """The best rival of an alignment that lies at a clearly different pose."""

    T_target_source: Pose
    probability: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """
    The verdict on one pair of maps.

    accepted, probability (0..1) of being right, reason (a sentence with numbers), the best pose
    found or None, its covariance (3, 3), V in percent (12), J per iteration (10), the share of
    the smaller map that overlaps, the best rival or None, and seconds per stage.
    """

    accepted: bool
    probability: float
    reason: str
    T_target_source: Pose | None = None
    covariance: Array = field(default_factory=lambda: np.full((3, 3), np.inf))
    verification_index: float = 0.0
    performance_index: tuple[float, ...] = ()
    overlap: float = 0.0
    runner_up: RunnerUp | None = None
    seconds: dict[str, float] = field(default_factory=dict)


def align(target: Grid, source: Grid, config: FusionConfig | None = None,
          rng: np.random.Generator | None = None) -> Alignment:
    """
    Find the pose of the source map in the target map.

    Never raises on maps that cannot be matched: "no match" is an Alignment with a reason.
    """
    raise NotImplementedError
