# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of SLAM on a live stream: odometry and scans in any order in, steps out.

Nothing here knows a message or a clock. One thread adds what arrives and never waits for SLAM;
another one takes the steps. A jump of time does not lose the map: where the odometry goes on,
SLAM goes on with shifted stamps; where it was set back too, a new map begins.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from threading import RLock
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import Odometry, OdometryBuffer
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.scan_queue import ScanQueue, StampGuard
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step

CONTINUED_DISTANCE = 1.0   # [m] odometry that moved less than this across a jump of time goes on
CONTINUED_HEADING = 1.0    # [rad]
STEP_ACROSS_JUMP = 0.1     # [s] that is taken to pass between two scans across a jump


class Session:
    """SLAM, the odometry it needs, and the scans that wait for it."""

    def __init__(self, config: SlamConfig, timeout: float, count: Callable[..., None],
                 checkpoint: Checkpoint | None = None) -> None:
        self._config, self._timeout, self._count = config, timeout, count
        self._lock = RLock()
        self.bodies = Bodies()    # of other robots, which are left out of the scans
        self.reset()
        if checkpoint is not None:
            self._resume(checkpoint)

    def reset(self) -> None:
        """Begin a new map."""
        with self._lock:
            self.slam = Slam(self._config, background=True)
            self._resumed = False
            self._buffer = OdometryBuffer(self._count)
            self._queue = ScanQueue(self._buffer, self._timeout, self._count)
            self._odometry_guard, self._scan_guard = StampGuard(), StampGuard()
            self._last_pose: Array | None = None
            self._last_stamp = -np.inf
            self._shift = 0.0
            self._jumped = False
            self._jumps = {'scan': 0, 'odometry': 0}
            self._hold_until = -np.inf

    def configure(self, config: SlamConfig) -> None:
        """Change the SLAM's parameters, for this map and those after it."""
        with self._lock:
            self._config = config
            self.slam.configure(config)

    def add_odometry(self, stamp: float, pose: Array, slip: Array | None = None) -> None:
        """Take T_odom_base (3,) at a stamp [s]."""
        with self._lock:
            self._add_odometry(stamp, pose, slip)

    def add_scan(self, scan: Scan, tag: Any, now: float) -> None:
        """Take a scan; the tag comes back with its step. now [s] is any steady time."""
        with self._lock:
            self._add_scan(scan, tag, now)

    def steps(self, now: float) -> Iterator[tuple[Any, Step]]:
        """Process the scans that odometry covers; yield each one's tag and step."""
        while True:
            with self._lock:
                held = now < self._hold_until
                self._buffer.lag = self.slam.odometry_lag
                found = None if held else next(self._queue.ready(now), None)
                if found is None:
                    return
                (scan, tag), odometry = found
                if self._jumped or (self._resumed and scan.stamp <= self._last_stamp):
                    self._rejoin(scan.stamp, odometry)
                self._resumed = False
                slam, stamp = self.slam, scan.stamp + self._shift
                self._last_pose = odometry.pose
                self._last_stamp = max(self._last_stamp, stamp)
            step = slam.process(replace(scan, stamp=stamp), odometry, self.bodies)
            if step.reason:
                self._count(step.reason, 'a scan was not used as it should')
            yield tag, step

    def _resume(self, checkpoint: Checkpoint) -> None:
        """Go on from a checkpoint of an earlier run."""
        self.slam = Slam(self._config, background=True, checkpoint=checkpoint)
        self._last_stamp, odometry = self.slam.last_stamp, checkpoint.tracker.odometry
        self._last_pose = None if odometry is None else odometry.pose
        self._resumed = True

    def _add_odometry(self, stamp: float, pose: Array, slip: Array | None) -> None:
        """Keep odometry unless its stamp is stray."""
        word = self._odometry_guard.check(stamp)
        if word == 'stray':
            self._count('odometry_stamps_stray', f'odometry is stamped {stamp:.3f} s')
            return
        if word != 'good':
            self._count(f'odometry_time_{word}', f'to {stamp:.3f} s')
            self._buffer.clear()
            self._jumps['odometry'] += 1
            self._hold_until = -np.inf
        self._buffer.add(stamp, pose, slip)

    def _add_scan(self, scan: Scan, tag: Any, now: float) -> None:
        """Let a scan wait unless its stamp is stray."""
        word = self._scan_guard.check(scan.stamp) if np.isfinite(scan.stamp) else 'stray'
        if word == 'stray':
            self._count('scan_stamps_stray', f'a scan is stamped {scan.stamp:.3f} s')
            return
        if word != 'good':
            self._count(f'scan_time_{word}', f'to {scan.stamp:.3f} s')
            self._queue.clear()
            self._jumped = True
            self._jumps['scan'] += 1
            if self._jumps['scan'] > self._jumps['odometry']:
                self._hold_until = now + self._timeout   # the odometry is still in the old time
        self._queue.add(scan.stamp, (scan, tag), now, scan.sweep)

    def _rejoin(self, stamp: float, odometry: Odometry) -> None:
        """Go on after a jump of time, with the map where the odometry goes on, else without."""
        self._jumped = False
        moved = np.zeros(3) if self._last_pose is None else between(self._last_pose, odometry.pose)
        if np.hypot(moved[0], moved[1]) < CONTINUED_DISTANCE and abs(moved[2]) < CONTINUED_HEADING:
            if np.isfinite(self._last_stamp):
                self._shift = self._last_stamp + STEP_ACROSS_JUMP - stamp
            return
        self._count('maps_begun_anew', 'time and odometry both jumped')
        self.slam = Slam(self._config, background=True)
        self._shift, self._last_stamp = 0.0, -np.inf
