# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The first scan after a restart: whether the odometry went on or began anew."""

from dataclasses import dataclass

from somfusion_ros.geometry import Array, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class RestartTuning:
    """How clearly the first scan after a restart must speak."""

    clearer: float = tuned(
        0.08, 'share of points', 'by which a match must win over the one at the odometry',
        'not measured')


TUNING = RestartTuning()


def odometry_began_anew(scan: Cloud, around: LocalMap, T_view_base: Array, step: Array) -> bool:
    """
    Tell whether a scan fits better where the robot stood than where the odometry puts it.

    around is what the last views saw, T_view_base (3,) where the robot stood in it, and step (3,)
    what the odometry says that it has moved since.
    """
    here = register(scan, around, T_view_base).inlier_ratio
    there = register(scan, around, compose(T_view_base, step)).inlier_ratio
    return here > there + TUNING.clearer
