# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that a robot is tracked in without changing it (localisation)."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, between, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.recovery import near
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.track import Track
from somfusion_ros.slam.trail import Trail


@dataclass(frozen=True)
class FixedMapTuning:
    """From which view of a fixed map a robot is tracked, and when it is astray."""

    gain: float = tuned(
        0.3, 'm', 'by which what another view saw must be nearer', 'not measured')
    step: tuple[float, float] = tuned(
        (0.4, 0.15), 'm, rad', 'between the poses seen from two views, at most', 'intel, wean')
    loss: float = tuned(
        0.05, 'share of points', 'that the other view may explain less', 'intel, wean')
    blind: int = tuned(
        10, 'scans', 'without a match, after which the robot is astray', 'not measured')


TUNING = FixedMapTuning()


class FixedMap(SingleMap):
    """Tracks a robot from the view that saw most of what it sees; adds none."""

    grows = False

    def __init__(self, config: SlamConfig, counters: Counter[str],
                 checkpoint: Checkpoint) -> None:
        super().__init__(config, counters, checkpoint)
        poses = self.graph.ekf.poses
        self.graph.trail = Trail()
        self.graph.to_close.clear()
        self._seen = np.array([apply(pose, middle[None])[0] for pose, middle in
                               zip(poses, self.graph.centres, strict=True)])

    def _goes_on(self, track: Track, seen: Cloud) -> bool:
        """Go on from the view that saw most of the scan; return whether it is another."""
        if not track.matched or self.tracker.lost:
            return False
        pose, poses = self.pose()[0], self.graph.ekf.poses
        away = np.hypot(*(self._seen - apply(pose, centre(seen)[None])).T)
        away += 0.5 * np.hypot(*(poses[:, :2] - pose[:2]).T)
        view = int(np.argmin(away))
        if away[view] + TUNING.gain > away[self._at]:
            return False
        expected = between(poses[view], compose(poses[self._at], self.tracker.T_view_base))
        local_map = self._local_map(view, self._members(view))
        match = register(seen, local_map, expected)
        if (match.inlier_ratio < track.inlier_ratio - TUNING.loss
                or not near(match.T_map_scan, expected, TUNING.step)):
            return False
        self._go_on(view, local_map, match.T_map_scan, match.covariance)
        return True

    def _is_astray(self, is_due: bool) -> bool:
        """Return whether no match tells any more that the robot is where it seems to be."""
        return self._blind >= TUNING.blind
