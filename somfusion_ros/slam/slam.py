# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""View-based SLAM of one robot: motion, matching, EKF, loop closure, mapping, in that order."""

from collections import Counter
from functools import partial
from threading import Lock

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam import loop_matching, loops, smoothing
from somfusion_ros.slam.checkpoint import Memory, State
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Relation
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.mapping import Mapper, MapScan
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.slam.step import Step
from somfusion_ros.slam.tracking import Track, Tracker

LOST_TRAVEL = 4.0  # a lost robot keeps matching against its last views for so many views' travel


class Slam:
    """
    EKF SLAM over past view poses.

    `process` is the scan path: its time does not depend on how many views there are. With
    `background` set, loops are closed by whoever calls `work`, from another thread; without,
    `process` does it, and the same input gives the same result.
    """

    def __init__(self, config: SlamConfig | None = None, background: bool = False,
                 state: State | None = None) -> None:
        self.config = config or SlamConfig()
        self.counters: Counter[str] = Counter()
        self._background = background
        self._lock = Lock()            # guards ekf, clouds, relations, scans
        self._map_lock = Lock()        # guards the mapper
        self._memory = Memory()
        self._tracker = Tracker(self.config)
        self._loops = loops.LoopClosure(self.config)
        self._mapper = Mapper(self.config.resolution)
        self._moved = 0.0              # [m] that loops moved the poses since the last re-solving
        self._last: Step | None = None
        if state is not None:
            self._resume(state)

    def configure(self, config: SlamConfig) -> None:
        """Take changed parameters; at another resolution the map is drawn anew."""
        with self._lock:
            self.config = self._tracker.config = config
        with self._map_lock:
            if config.resolution != self._mapper.resolution:
                self._mapper = Mapper(config.resolution)

    def process(self, scan: Scan, odometry: Odometry) -> Step:
        """Follow the robot through one scan; bad input is counted and changes nothing."""
        self.counters['scans'] += 1
        fault = scan.fault() or odometry.fault() or self._stamp_fault(scan.stamp)
        if fault:
            return self._refuse(scan, fault)
        seen = cloud(scan, self.config.max_laser_range, odometry.twist)
        with self._lock:
            track = self._tracker.step(seen, odometry)
            is_view = self._is_view(track, seen)
            if is_view:
                self._add_view(scan.stamp, seen, track)
            step = self._record(scan, seen, odometry, track, is_view)
        while not self._background and self.work():
            pass
        return step

    def work(self) -> bool:
        """Try to close one waiting view's loops; return whether there was one."""
        with self._lock:
            if not self._memory.to_close:
                return False
            new = self._memory.to_close.popleft()
            memory = self._memory
            targets = loops.candidates(new, memory.ekf, np.array(memory.centres), self.config)
            poses = memory.ekf.poses.copy()
        seen = loop_matching.recent(new, poses, self._memory.clouds) if targets else None
        around = partial(loop_matching.local_map, newest=new - self.config.loop_minimum_gap,
                         poses=poses, clouds=self._memory.clouds)
        for target in targets:
            found = loop_matching.match(target, new, seen, around, self.config)
            if found is None:
                self.counters['loops_rejected'] += 1
            else:
                self._close(found)
        self._relinearise()
        return True

    def grid(self) -> Grid:
        """Map at the poses held now; slow after a loop, so not for the scan path."""
        with self._lock:
            scans, poses = list(self._memory.scans), self._memory.ekf.poses.copy()
        with self._map_lock:
            return self._mapper.render(scans, poses)

    def views(self) -> tuple[Array, Array]:
        """Stamps (n,) and poses T_map_base (n, 3) of the views, as corrected by all loops."""
        with self._lock:
            return np.array(self._memory.stamps), self._memory.ekf.poses.copy()

    def trajectory(self) -> tuple[Array, Array]:
        """Stamps (m,) and poses T_map_base (m, 3) of every scan used, corrected."""
        with self._lock:
            if not self._memory.track:
                return np.zeros(0), np.zeros((0, 3))
            stamps, views, hung = zip(*self._memory.track, strict=True)
            return np.array(stamps), compose(self._memory.ekf.poses[list(views)], np.array(hung))

    def state(self) -> State:
        """Give what a later run can go on from."""
        with self._lock:
            return State.of(self._memory, self._tracker.state())

    @property
    def last_stamp(self) -> float:
        """Stamp [s] of the last scan used; -inf before the first."""
        return self._last.stamp if self._last else -np.inf

    @property
    def odometry_lag(self) -> float:
        """Time [s] to add to a scan's stamp to find the odometry that belongs to it."""
        return self._tracker.calibration.lag

    @property
    def pose_sigma(self) -> tuple[float, float, float]:
        """Standard deviations of the current pose [m, m, rad]."""
        if self._last is None:
            return 0.0, 0.0, 0.0
        return tuple(float(s) for s in np.sqrt(np.diag(self._last.covariance)))

    def _stamp_fault(self, stamp: float) -> str:
        """Name a stamp that repeats or runs backward."""
        if self._last is None or stamp > self._last.stamp:
            return ''
        return 'scan_stamps_repeated' if stamp == self._last.stamp else 'scan_stamps_backward'

    def _refuse(self, scan: Scan, reason: str) -> Step:
        """Count a scan that cannot be used."""
        self.counters[reason] += 1
        last = self._last
        return Step(scan.stamp, last.pose if last else Pose(),
                    last.covariance if last else np.zeros((3, 3)),
                    last.T_map_odom if last else Pose(), False, False, 0.0, False, reason)

    def _is_view(self, track: Track, seen: Cloud) -> bool:
        """Keep the first usable scan, then one per minimum travel."""
        if not self._memory.clouds:
            return len(seen) > 0
        x, y, theta = track.T_view_base
        share = LOST_TRAVEL if self._tracker.lost else 1.0
        return bool(np.hypot(x, y) >= share * self.config.minimum_travel_distance
                    or abs(theta) >= share * self.config.minimum_travel_heading)

    def _add_view(self, stamp: float, seen: Cloud, track: Track) -> None:
        """Let the filter keep the current pose, and match against it from now on."""
        new = self._memory.ekf.augment(track.T_view_base, track.R)
        if new:
            self._memory.relations.append(Relation(new - 1, new, track.T_view_base, track.R))
        self._memory.clouds.append(seen)
        self._memory.centres.append(loops.centre(seen))
        self._memory.stamps.append(stamp)
        self._look_around()
        self._memory.to_close.append(new)

    def _look_around(self) -> None:
        """Match against what the last views saw from now on."""
        first = -self.config.local_map_views
        poses, clouds = self._memory.ekf.poses, self._memory.clouds
        self._tracker.start_view(LocalMap.of_views(
            clouds[first:], list(between(poses[-1], poses[first:]))))

    def _resume(self, state: State) -> None:
        """Go on where another run ended; the robot may have moved meanwhile."""
        self._memory = state.resumed()
        self.counters['views'] = len(self._memory.clouds)
        if self._memory.clouds:
            self._look_around()
        self._tracker.resume(state.tracker)
        pose, covariance = self._pose()
        T_map_odom = compose(pose, inverse(self._tracker.odometry.pose))
        self._last = Step(self._memory.track[-1][0], Pose.from_array(pose), covariance,
                          Pose.from_array(T_map_odom), True, False, 0.0, False, '')

    def _record(self, scan: Scan, seen: Cloud, odometry: Odometry, track: Track,
                is_view: bool) -> Step:
        """Keep the scan for trajectory and map, and say what it did."""
        for name, true in (('matches_accepted', track.matched), ('views', is_view),
                           (track.reason, bool(track.reason))):
            if true:
                self.counters[name] += 1
        hung = self._tracker.T_view_base
        if self._memory.clouds:
            view = self._memory.ekf.n - 1
            self._memory.track.append((scan.stamp, view, hung))
            if is_view or self._adds_to_map(view, hung):
                self._memory.scans.append(MapScan(view, hung, seen))
        pose, covariance = self._pose()
        T_map_odom = compose(pose, inverse(odometry.pose))
        self._last = Step(scan.stamp, Pose.from_array(pose), covariance,
                          Pose.from_array(T_map_odom), True, track.matched, track.inlier_ratio,
                          is_view, track.reason)
        return self._last

    def _adds_to_map(self, view: int, hung: Array) -> bool:
        """Tell whether the robot moved enough, since the last scan kept, for a new map scan."""
        last = self._memory.scans[-1]
        d = hung - last.T_view_base
        return bool(view == last.view and (np.hypot(d[0], d[1]) >= self.config.map_scan_distance
                                           or abs(d[2]) >= self.config.map_scan_distance))

    def _pose(self) -> tuple[Array, Array]:
        """Compose last view and tracker: pose T_map_base (3,) and its covariance (3, 3)."""
        if not self._memory.ekf.n:
            return self._tracker.T_view_base, self._tracker.covariance
        return self._memory.ekf.ahead(self._tracker.T_view_base, self._tracker.covariance)

    def _close(self, found: loops.Loop) -> None:
        """Let the filter take what is trusted."""
        with self._lock:
            relations = self._loops.trusted(found, self._memory.ekf)
            for relation in relations:
                self._moved += self._memory.ekf.update(relation)
                self._memory.relations.append(relation)
        self.counters['loops_accepted'] += len(relations)
        if not relations:
            self.counters['loops_held_back'] += 1

    def _relinearise(self) -> None:
        """Re-solve the whole problem once loops have moved the poses far."""
        if self._moved < self.config.relinearise_distance:
            return
        with self._lock:
            poses, relations = self._memory.ekf.poses.copy(), list(self._memory.relations)
        solved = smoothing.solve(poses, relations)
        with self._lock:
            self._memory.ekf.relinearise(solved)
            self._moved = 0.0
        self.counters['relinearisations'] += 1
