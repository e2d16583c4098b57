# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The first scan after a restart: whether the odometry went on, or began anew."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class RestartTuning:
    """How clearly the first scan after a restart must speak."""

    clearer: float = tuned(
        0.08, 'share of points', 'by which a match must win over the one at the odometry',
        'not measured')
    pause: float = tuned(
        20.0, 's', 'between two scans, and', 'MIT CSAIL')
    drove: tuple[float, float] = tuned(
        (0.3, 5.0), 'm, rad', 'of odometry meanwhile, with which the robot is taken to have gone '
        'on: with less it may have been carried, or its odometry began anew; more says too little',
        'MIT CSAIL')
    fastest: float = tuned(
        2.0, 'm/s, rad/s', 'on average meanwhile; faster, it is another odometry', 'by design')


TUNING = RestartTuning()


class Resumed(Protocol):
    """What goes on: its newest odometry, and whether that may have begun anew since."""

    odometry: Odometry | None
    resumed: bool


def odometry_began_anew(scan: Cloud, around: LocalMap, T_view_base: Array, step: Array) -> bool:
    """
    Tell whether a scan fits better where the robot stood than where the odometry puts it.

    around is what the last views saw, T_view_base (3,) where the robot stood in it, and step (3,)
    what the odometry says that it has moved since.
    """
    here = register(scan, around, T_view_base).inlier_ratio
    there = register(scan, around, compose(T_view_base, step)).inlier_ratio
    return here > there + TUNING.clearer


def went_on(tracker: Resumed, now: Odometry) -> bool:
    """Tell whether the robot clearly drove on for a while; the tracker then follows odometry."""
    before = tracker.odometry
    if before is None or not _drove_on(before, now):
        return False
    tracker.resumed = False
    return True


def _drove_on(before: Odometry, now: Odometry) -> bool:
    """Tell whether two samples may well be of one odometry, between which the robot drove."""
    pause, (least, most) = now.stamp - before.stamp, TUNING.drove
    x, y, turn = np.abs(between(before.pose, now.pose))
    moved = max(float(np.hypot(x, y)), float(turn))
    at_zero, was_at_zero = (bool((np.abs(o.pose) < least).all()) for o in (now, before))
    return (0.0 < pause <= TUNING.pause and least <= moved <= min(most, TUNING.fastest * pause)
            and (was_at_zero or not at_zero))
