# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what a scan shows agrees with what others saw at the same place."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, Array
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class AgreementTuning:
    """Which points agree with a surface."""

    on_surface: float = tuned(
        0.12, 'm', 'a point this near lies on the old surface', 'not measured')
    conflict: float = tuned(
        0.2, 'm', 'a point this far lies off it', 'not measured')
    points: int = tuned(
        30, 'points', 'that are judged, at least', 'not measured')
    denied: float = tuned(
        0.5, 'share of points', 'judged, below which a scan denies what others saw', 'shared logs')


TUNING = AgreementTuning()


def judge(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> tuple[int, int]:
    """Count the points of a cloud at a pose (3,) on the old surface, and in free space off it."""
    p = apply(T_map_scan, cloud.points)
    distance, _ = target.tree.query(p, distance_upper_bound=TUNING.conflict)
    far = ~np.isfinite(distance)
    return (int((distance < TUNING.on_surface).sum()),
            int((far & target.seen_through(p)).sum()))


def denies(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> bool | None:
    """Return whether a cloud at a pose (3,) denies a surface; None where little says so or not."""
    on, against = judge(T_map_scan, cloud, target)
    if on + against < TUNING.points:
        return None
    return on < TUNING.denied * (on + against)
