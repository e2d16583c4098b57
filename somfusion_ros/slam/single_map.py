# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One map that grows without a break: motion, matching, EKF, loop closure, in that order."""

from collections import Counter, deque
from threading import Lock

import numpy as np
from somfusion_ros.geometry import Array, between, compose, compose_jacobians, inverse, Pose
from somfusion_ros.slam import places
from somfusion_ros.slam.checkpoint import Checkpoint, ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.covariance import seen_turned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loop_closer import LoopCloser
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.step import Step
from somfusion_ros.slam.successors import Successors
from somfusion_ros.slam.track import Track
from somfusion_ros.slam.tracking import Tracker
from somfusion_ros.slam.view_tuning import TUNING

LOOSE = np.diag([10.0, 10.0, 1.0]) ** 2   # of a piece of map before its match


class SingleMap:
    """
    EKF SLAM over past view poses.

    `follow` is the scan path: its time does not grow with the views. Loops are closed by
    `closer.work`, which may run in another thread; the lock guards the graph.
    """

    grows = True   # whether what is seen becomes part of the map

    def __init__(self, config: SlamConfig, counters: Counter[str],
                 checkpoint: Checkpoint | None = None) -> None:
        self.config, self.counters = config, counters
        self.lock = Lock()
        self.graph = checkpoint.graph() if checkpoint else ViewGraph()
        self.tracker = Tracker(config)
        self.closer = LoopCloser(self.graph, self.lock, config, counters)
        self.last: Step | None = None
        self._blind = 0                        # scans since the last match
        self.astray = False                    # the robot is not where it seems to be
        self._at = -1                          # view that the tracker's pose is relative to
        self._around: list[int] = []           # views that it matches against, by age
        self._fresh: deque[int] = deque(maxlen=config.loop_minimum_gap)   # added lately
        self._denied: list[int] = []           # old views here that do not explain the scan
        self._successors = Successors()
        if checkpoint is not None:
            self._resume(checkpoint)

    def configure(self, config: SlamConfig) -> None:
        """Change the parameters."""
        with self.lock:
            self.config = self.tracker.config = self.closer.config = config
            self._fresh = deque(self._fresh, config.loop_minimum_gap)

    def follow(self, stamp: float, seen: Cloud, odometry: Odometry) -> Step:
        """Follow the robot through one scan."""
        with self.lock:
            track = self.tracker.step(seen, odometry)
            self._blind = 0 if track.matched or not self.graph.clouds else self._blind + 1
            self.closer.doubts.follow(track.fits(self.config.doubtful_inlier_ratio), MapScan(
                self._at, self.tracker.T_view_base, seen.outline), track.inlier_ratio)
            is_due = self._is_due(track, seen)
            self.astray = self._is_astray(is_due)
            goes_on = is_due and not self.astray and self._goes_on(track, seen)
            if goes_on and not self.closer.doubts.about(self._at):
                self.graph.replace(self._successors.confirm(self._at, stamp))
            is_view = is_due and not self.astray and not goes_on and self._keeps(track)
            if is_view:
                self._add_view(stamp, seen, track)
            return self._record(stamp, seen, odometry, track, is_view)

    def drawn(self) -> tuple[list[MapScan], Array]:
        """Return the scans kept for the map, and the poses (n, 3) of the views they hang on."""
        with self.lock:
            return self.graph.scans.copy(), self.graph.ekf.poses.copy()

    def views(self) -> tuple[Array, Array]:
        """Return stamps (n,) and poses T_map_base (n, 3) of the views, corrected by all loops."""
        with self.lock:
            return np.array(self.graph.stamps), self.graph.ekf.poses.copy()

    def trajectory(self) -> tuple[Array, Array]:
        """Return the stamps (m,) and poses T_map_base (m, 3) of every scan used, corrected."""
        with self.lock:
            trail = self.graph.trail
            return trail.stamps.copy(), compose(self.graph.ekf.poses[trail.views], trail.poses)

    def checkpoint(self) -> Checkpoint:
        """Return what a later run can go on from."""
        with self.lock:
            return Checkpoint.of(self.graph, self._at, self.tracker.state(), self._around,
                                 self._fresh)

    def _resume(self, checkpoint: Checkpoint) -> None:
        """Go on where another run ended; the robot may have moved meanwhile."""
        self._at = checkpoint.view
        self.counters['views'] = len(self.graph.clouds)
        self._around = list(checkpoint.around or self._members(self._at))
        self._fresh.extend(checkpoint.fresh)
        self.tracker.start_view(self.graph.local_map(self._at, self._around))
        self.tracker.resume(checkpoint.tracker)
        pose, covariance = self.pose()
        T_odom_base = checkpoint.tracker.odometry.pose if checkpoint.tracker.odometry else Pose()
        T_map_odom = compose(pose, inverse(T_odom_base))
        self.last = Step(float(self.graph.trail.stamps[-1]), Pose.from_array(pose), covariance,
                         Pose.from_array(T_map_odom), True, False, 0.0, False, '', self._at)

    def _is_due(self, track: Track, seen: Cloud) -> bool:
        """Return whether a view is due: with the first usable scan, then per minimum travel."""
        if not self.graph.clouds:
            return len(seen) > 0
        x, y, theta = track.T_view_base
        share = TUNING.lost_travel if self.tracker.lost else 1.0
        return bool(np.hypot(x, y) >= share * self.config.minimum_travel_distance
                    or abs(theta) >= share * self.config.minimum_travel_heading)

    def _keeps(self, track: Track) -> bool:
        """Return whether a view that is due is kept."""
        return True

    def _add_view(self, stamp: float, seen: Cloud, track: Track) -> None:
        """Add the current pose to the filter, and match against what it saw from now on."""
        link = Constraint(self._at, self.graph.ekf.n, track.T_view_base, track.R)
        new = self.graph.add(link, seen, stamp)
        if self.grows:
            self.closer.doubts.add(new, self._around)
        self._successors.add(new, self._denied, stamp)
        self._at = new
        self._fresh.append(new)
        self._around = [*self._around, new][-self.config.local_map_views:]
        self.tracker.start_view(self.graph.local_map(new, self._around))

    def _members(self, view: int) -> range:
        """Return the views whose surface an old view is matched with."""
        return places.members(view, self.graph.chain(view), self.config.local_map_views)

    def _goes_on(self, track: Track, seen: Cloud) -> bool:
        """Go on from an old view where the place is known; return whether it is."""
        self._denied, ekf = [], self.graph.ekf
        if not track.matched or self.tracker.lost or not ekf.n:
            return False
        usable = self.graph.showing()
        usable[[self._at, *self._fresh]] = False
        pose = self.pose()[0]
        place = places.known(pose, ekf.poses, usable, self.graph.scans.often(pose), self.config)
        for k, view in enumerate(place.views):
            found = places.explain(places.Expected(view, *self._seen_from(view)), seen,
                                   lambda k: self.graph.local_map(k, self._members(k)),
                                   track.inlier_ratio - place.loss, self.config)
            if found is not None and found.whole:
                self._go_on(view, found.local_map, found.T_view_base, found.P)
                self.closer.doubts.go_on()
                self.counters['places_known'] += 1
                return True
            if found is not None and k < place.here and self.grows:
                self._denied.append(view)
        return False

    def _go_on(self, view: int, local_map: LocalMap, T_view_base: Array, P: Array) -> None:
        """Go on from an old view, at a pose (3,) and covariance (3, 3) in it."""
        self._at, self._around = view, list(self._members(view))
        self._fresh.clear()
        self.tracker.go_on(local_map, T_view_base, P)

    def _is_astray(self, is_due: bool) -> bool:
        """Return whether no match tells any more that the robot is where it seems to be."""
        if self._blind == 0 or len(self.graph.clouds) < TUNING.known:
            return self.closer.doubts.take_back()
        return self._blind >= (TUNING.blind_due if is_due else TUNING.blind)

    def stand(self, pose: Array, P: Array, tracker: Tracker | None = None,
              stamp: float | None = None) -> None:
        """Go on at a pose (3,) with covariance (3, 3); a scan of a stamp [s] was taken there."""
        with self.lock:
            poses = self.graph.ekf.poses
            view = places.nearest_seen(pose, poses, self.graph.clouds, self.config)
            self.tracker, self._blind = tracker or self.tracker, 0
            self.tracker.config, self.tracker.placed = self.config, False
            self._go_on(view, self.graph.local_map(view, self._members(view)),
                        between(poses[view], pose), seen_turned(P, poses[view, 2]))
            if stamp is not None:
                self.graph.trail.append(stamp, self._at, self.tracker.T_view_base)

    def absorb(self, piece: 'SingleMap', view: int, T_map_view: Array, P: Array) -> None:
        """
        Join a piece of map whose view lies at a pose (3,), known to P (3, 3), and go on with it.

        The piece is hung loosely first; the match of the view then holds it.
        """
        with self.lock, piece.lock:
            graph, first = self.graph, self.graph.ekf.n
            away = places.distance(T_map_view, graph.ekf.poses, self.config)
            old = int(np.where(graph.ekf.kept, away, np.inf).argmin())
            T_map_old = graph.ekf.poses[old].copy()
            start = compose(T_map_view, between(*piece.graph.ekf.poses[[view, 0]]))
            graph.join(piece.graph, Constraint(old, first, between(T_map_old, start), LOOSE))
            tie = Constraint(old, first + view, between(T_map_old, T_map_view),
                             seen_turned(P, T_map_old[2]))
            graph.ekf.update(tie)
            graph.constraints.append(tie)
            piece.tracker.config = self.config    # which may have changed since the piece began
            self.tracker, self._blind = piece.tracker, 0
            self._at = piece._at + first
            self._around = [k + first for k in piece._around]
            self._fresh = deque((k + first for k in piece._fresh), self._fresh.maxlen)

    def _seen_from(self, view: int) -> tuple[Array, Array]:
        """Return T_view_base (3,) as seen from an old view, and its covariance (3, 3)."""
        T_view_at, P = self.graph.ekf.relative(view, self._at)
        F, G = compose_jacobians(T_view_at, self.tracker.T_view_base)
        return (compose(T_view_at, self.tracker.T_view_base),
                F @ P @ F.T + G @ self.tracker.covariance @ G.T)

    def _record(self, stamp: float, seen: Cloud, odometry: Odometry, track: Track,
                is_view: bool) -> Step:
        """Record the scan for trajectory and map; return what it did."""
        self.counters.update(matches_accepted=int(track.matched), views=int(is_view))
        self.counters.update([track.reason] if track.reason else [])
        hung = self.tracker.T_view_base
        if self.graph.clouds:
            self.graph.trail.append(stamp, self._at, hung)
        pose, covariance = self.pose()
        scan = MapScan(self._at, hung, seen.outline)
        if self.graph.clouds and self.grows and is_view:
            self.graph.scans.add(scan, pose, stamp)
        elif self.graph.clouds and self.grows and not self.tracker.lost:
            self.graph.scans.offer(scan, pose, stamp, self.config.map_scan_distance)
        T_map_odom = Pose.from_array(compose(pose, inverse(odometry.pose)))
        self.last = Step(stamp, Pose.from_array(pose), covariance, T_map_odom, True, track.matched,
                         track.inlier_ratio, is_view, track.reason, max(self._at, 0), track.moved)
        return self.last

    def pose(self) -> tuple[Array, Array]:
        """Compose last view and tracker: pose T_map_base (3,) and its covariance (3, 3)."""
        if not self.graph.ekf.n:
            return self.tracker.T_view_base, self.tracker.covariance
        return self.graph.ekf.ahead(self.tracker.T_view_base, self.tracker.covariance, self._at)
