# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A map that a robot is tracked in without changing it (localisation).

Where the map does not show what the robot sees, it goes on by views of its own, which are tied to
the map as loops are; the map is rigid, so that they bend and it does not. They are no part of it.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import apply, Array, between, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.handover import handed_over
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.recovery import near
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.track import Track
from somfusion_ros.slam.tracking import Tracker
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
    leaves: float = tuned(
        0.75, 'share of points', 'explained; below, the robot leaves what the map shows',
        'intel, wean')
    returns: float = tuned(
        0.85, 'share of points', 'explained; above, it is back where the map shows it',
        'intel, wean')
    rigid: tuple[float, float, float] = tuned(
        (1e-4, 1e-4, 1e-5), 'm, m, rad', 'sigmas between two views of the map', 'by design')
    blind: int = tuned(
        10, 'scans', 'without a match, after which the robot is astray', 'not measured')


TUNING = FixedMapTuning()


class FixedMap(SingleMap):
    """Tracks a robot from the view of a map that saw most of what it sees."""

    grows = False

    def __init__(self, config: SlamConfig, counters: Counter[str],
                 checkpoint: Checkpoint) -> None:
        super().__init__(config, counters, rigid(checkpoint))
        self._map = checkpoint
        self.graph.trail = Trail()
        self.graph.to_close.clear()
        self._seen = np.array([apply(pose, middle[None])[0] for pose, middle in
                               zip(checkpoint.poses, self.graph.centres, strict=True)])

    def drawn(self) -> tuple[list[MapScan], Array]:
        """Return the scans kept for the map, and the poses (n, 3) of the views they hang on."""
        return list(self._map.scans), self._map.poses.copy()

    def views(self) -> tuple[Array, Array]:
        """Return stamps (n,) and poses T_map_base (n, 3) of the map's views."""
        return self._map.stamps.copy(), self._map.poses.copy()

    def checkpoint(self) -> Checkpoint:
        """Return the map as it was, with the trail of this run hung on its views."""
        with self.lock:
            rows, state, at = self.graph.trail.rows, self.tracker.state(), self._at
            poses, parents = self.graph.ekf.poses.copy(), self.graph.ekf.parents
            hung = np.arange(len(poses))
            for own in range(len(self._map.poses), len(poses)):
                hung[own] = hung[parents[own]]
        seen_from = between(poses[hung], poses)      # of every view, from the map's it hangs on
        views = rows[:, 1].astype(np.intp)
        rows[:, 1], rows[:, 2:] = hung[views], compose(seen_from[views], rows[:, 2:])
        state = replace(state, T_view_base=compose(seen_from[at], state.T_view_base))
        return replace(self._map, trail=rows, to_close=(), view=int(hung[at]), tracker=state)

    def stand(self, pose: Array, P: Array, tracker: Tracker | None = None,
              stamp: float | None = None) -> None:
        """Go on at a pose (3,) with covariance (3, 3), without views of its own before."""
        with self.lock:
            self._forget()
        super().stand(pose, P, tracker, stamp)

    def _goes_on(self, track: Track, seen: Cloud) -> bool:
        """Go on from the view that saw most of the scan; return whether it is another."""
        if not track.matched or self.tracker.lost:
            return False
        pose, own = self.pose()[0], self._own
        away = np.hypot(*(self._seen - apply(pose, centre(seen)[None])).T)
        away += 0.5 * np.hypot(*(self._map.poses[:, :2] - pose[:2]).T)
        view = int(np.argmin(away))
        if not own and away[view] + TUNING.gain > away[self._at]:
            return False
        expected, P = self._seen_from(view)
        local_map = self.graph.local_map(view, self._members(view))
        match = register(seen, local_map, expected)
        least = TUNING.returns if own else track.inlier_ratio - TUNING.loss
        if match.inlier_ratio < least or not near(match.T_map_scan, expected, TUNING.step):
            return own and super()._goes_on(track, seen)
        self._go_on(view, local_map, *handed_over(match, expected, P))
        return True

    def _keeps(self, track: Track) -> bool:
        """Return whether a view that is due is kept, as the map does not show what is seen."""
        return self._own or track.matched and track.inlier_ratio < TUNING.leaves

    @property
    def _own(self) -> bool:
        """Whether the robot is tracked from a view of its own."""
        return self._at >= len(self._map.poses)

    def _is_astray(self, is_due: bool) -> bool:
        """Return whether no match tells any more that the robot is where it seems to be."""
        astray = (self.closer.doubts.take_back() if self._blind == 0 else
                  self._blind >= TUNING.blind)
        if astray:
            self._forget()
        return astray

    def _forget(self) -> None:
        """Let the views of its own show nothing any more."""
        self.graph.hide(range(len(self._map.poses), self.graph.ekf.n))
        self.graph.to_close.clear()
        self.closer.doubts.clear()


def rigid(checkpoint: Checkpoint) -> Checkpoint:
    """Return a map that no loop bends: every view is tied fast to the one that it came from."""
    parents = {c.second: c.first for c in reversed(checkpoint.constraints)}
    R, poses = np.diag(TUNING.rigid) ** 2, checkpoint.poses
    ties = [Constraint(parents[k], k, between(poses[parents[k]], poses[k]), R)
            for k in range(1, len(poses))]
    return replace(checkpoint, constraints=ties)
