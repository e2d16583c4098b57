# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One map that grows without a break: motion, matching, EKF, loop closure, in that order."""

from collections import Counter
from dataclasses import dataclass
from functools import partial
from threading import Lock

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.slam import loop_matching, loops, smoothing
from somfusion_ros.slam.checkpoint import Checkpoint, ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.mapping import MapScan
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.step import Step
from somfusion_ros.slam.tracking import Track, Tracker


@dataclass(frozen=True)
class ViewTuning:
    """When a view is kept."""

    lost_travel: float = tuned(
        4.0, 'views', "a lost robot keeps matching against its last views for so many views' "
        'travel before it keeps a new one', 'mit-csail')


TUNING = ViewTuning()


class SingleMap:
    """
    EKF SLAM over past view poses.

    `follow` is the scan path: its time does not depend on how many views there are. `work`
    closes loops and may run in another thread; the lock guards the graph.
    """

    def __init__(self, config: SlamConfig, counters: Counter[str]) -> None:
        self.config, self.counters = config, counters
        self.lock = Lock()
        self.graph = ViewGraph()
        self.tracker = Tracker(config)
        self.closure = loops.LoopClosure(config)
        self.last: Step | None = None
        self._moved = 0.0              # [m] that loops moved the poses since the last re-solving

    def configure(self, config: SlamConfig) -> None:
        """Change the parameters."""
        with self.lock:
            self.config = self.tracker.config = config

    def follow(self, stamp: float, seen: Cloud, odometry: Odometry) -> Step:
        """Follow the robot through one scan."""
        with self.lock:
            track = self.tracker.step(seen, odometry)
            is_view = self._is_view(track, seen)
            if is_view:
                self._add_view(stamp, seen, track)
            return self._record(stamp, seen, odometry, track, is_view)

    def work(self) -> bool:
        """Try to close one waiting view's loops; return whether there was one."""
        with self.lock:
            if not self.graph.to_close:
                return False
            new = self.graph.to_close.popleft()
            graph = self.graph
            targets = loops.candidates(new, graph.ekf, np.array(graph.centres), self.config)
            poses = graph.ekf.poses.copy()
        if targets:
            self._match_loops(new, targets, poses)
        self._relinearise()
        return True

    def _match_loops(self, new: int, targets: list[loops.Candidate], poses: Array) -> None:
        """Match a view against old places; update the filter by what is trusted."""
        seen = loop_matching.recent(new, poses, self.graph.clouds)
        around = partial(loop_matching.local_map, newest=new - self.config.loop_minimum_gap,
                         poses=poses, clouds=self.graph.clouds)
        for target in targets:
            found = loop_matching.match(target, new, seen, around, self.config)
            if found is None:
                self.counters['loops_rejected'] += 1
            else:
                self._close(found)

    def drawn(self) -> tuple[list[MapScan], Array]:
        """Return the scans kept for the map, and the poses (n, 3) of the views they hang on."""
        with self.lock:
            return list(self.graph.scans), self.graph.ekf.poses.copy()

    def views(self) -> tuple[Array, Array]:
        """Return stamps (n,) and poses T_map_base (n, 3) of the views, corrected by all loops."""
        with self.lock:
            return np.array(self.graph.stamps), self.graph.ekf.poses.copy()

    def trajectory(self) -> tuple[Array, Array]:
        """Return the stamps (m,) and poses T_map_base (m, 3) of every scan used, corrected."""
        with self.lock:
            if not self.graph.track:
                return np.zeros(0), np.zeros((0, 3))
            stamps, views, hung = zip(*self.graph.track, strict=True)
            return np.array(stamps), compose(self.graph.ekf.poses[list(views)], np.array(hung))

    def checkpoint(self) -> Checkpoint:
        """Return what a later run can go on from."""
        with self.lock:
            return Checkpoint.of(self.graph, self.tracker.state())

    def resume(self, checkpoint: Checkpoint) -> None:
        """Go on where another run ended; the robot may have moved meanwhile."""
        self.graph = checkpoint.resumed()
        self.counters['views'] = len(self.graph.clouds)
        if self.graph.clouds:
            self._look_around()
        self.tracker.resume(checkpoint.tracker)
        pose, covariance = self._pose()
        T_odom_base = checkpoint.tracker.odometry.pose if checkpoint.tracker.odometry else Pose()
        T_map_odom = compose(pose, inverse(T_odom_base))
        self.last = Step(self.graph.track[-1][0], Pose.from_array(pose), covariance,
                         Pose.from_array(T_map_odom), True, False, 0.0, False, '')

    def _is_view(self, track: Track, seen: Cloud) -> bool:
        """Return whether a scan becomes a view: the first usable, then one per minimum travel."""
        if not self.graph.clouds:
            return len(seen) > 0
        x, y, theta = track.T_view_base
        share = TUNING.lost_travel if self.tracker.lost else 1.0
        return bool(np.hypot(x, y) >= share * self.config.minimum_travel_distance
                    or abs(theta) >= share * self.config.minimum_travel_heading)

    def _add_view(self, stamp: float, seen: Cloud, track: Track) -> None:
        """Add the current pose to the filter, and match against what it saw from now on."""
        new = self.graph.ekf.augment(track.T_view_base, track.R)
        if new:
            self.graph.constraints.append(Constraint(new - 1, new, track.T_view_base, track.R))
        self.graph.clouds.append(seen)
        self.graph.centres.append(loops.centre(seen))
        self.graph.stamps.append(stamp)
        self._look_around()
        self.graph.to_close.append(new)

    def _look_around(self) -> None:
        """Match against what the last views saw from now on."""
        first = -self.config.local_map_views
        poses, clouds = self.graph.ekf.poses, self.graph.clouds
        self.tracker.start_view(LocalMap.of_views(
            clouds[first:], list(between(poses[-1], poses[first:]))))

    def _record(self, stamp: float, seen: Cloud, odometry: Odometry, track: Track,
                is_view: bool) -> Step:
        """Record the scan for trajectory and map; return what it did."""
        for name, true in (('matches_accepted', track.matched), ('views', is_view),
                           (track.reason, bool(track.reason))):
            if true:
                self.counters[name] += 1
        hung = self.tracker.T_view_base
        if self.graph.clouds:
            view = self.graph.ekf.n - 1
            self.graph.track.append((stamp, view, hung))
            if is_view or self._adds_to_map(view, hung):
                self.graph.scans.append(MapScan(view, hung, seen))
        pose, covariance = self._pose()
        T_map_odom = compose(pose, inverse(odometry.pose))
        self.last = Step(stamp, Pose.from_array(pose), covariance,
                         Pose.from_array(T_map_odom), True, track.matched, track.inlier_ratio,
                         is_view, track.reason)
        return self.last

    def _adds_to_map(self, view: int, hung: Array) -> bool:
        """Return whether the robot moved enough since the last map scan for a new one."""
        last = self.graph.scans[-1]
        d = hung - last.T_view_base
        return bool(view == last.view and (np.hypot(d[0], d[1]) >= self.config.map_scan_distance
                                           or abs(d[2]) >= self.config.map_scan_distance))

    def _pose(self) -> tuple[Array, Array]:
        """Compose last view and tracker: pose T_map_base (3,) and its covariance (3, 3)."""
        if not self.graph.ekf.n:
            return self.tracker.T_view_base, self.tracker.covariance
        return self.graph.ekf.ahead(self.tracker.T_view_base, self.tracker.covariance,
                                    self.graph.ekf.n - 1)

    def _close(self, found: loops.Loop) -> None:
        """Update the filter by the constraints that are trusted now."""
        with self.lock:
            constraints = self.closure.trusted(found, self.graph.ekf)
            for constraint in constraints:
                self._moved += self.graph.ekf.update(constraint)
                self.graph.constraints.append(constraint)
        self.counters['loops_accepted'] += len(constraints)
        if not constraints:
            self.counters['loops_held_back'] += 1

    def _relinearise(self) -> None:
        """Re-solve the whole problem once loops have moved the poses far."""
        if self._moved < self.config.relinearise_distance:
            return
        with self.lock:
            poses, constraints = self.graph.ekf.poses.copy(), list(self.graph.constraints)
        solved = smoothing.solve(poses, constraints)
        with self.lock:
            self.graph.ekf.relinearise(solved)
            self._moved = 0.0
        self.counters['relinearisations'] += 1
