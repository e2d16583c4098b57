# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of SLAM on a stream: odometry and scans in any order in, steps out.

Nothing here knows a message or a clock. One thread adds what arrives and never waits for SLAM;
another one takes the steps. A jump of time does not lose the map, see `Pairing`; where the
odometry was set back too, a new map begins.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from threading import RLock
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.beam_orders import BeamOrders, Early
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.motion_guess import MotionGuess
from somfusion_ros.slam.pairing import continued, Paired, Pairing
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.scan_queue import MAX_WAITING
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.start import Start
from somfusion_ros.slam.step import Step

REASONS = {
    'scan_stamps_repeated': 'a scan has the stamp of the one before it',
    'scan_stamps_backward': 'a scan is older than the one before it',
    'odometry_jumps': 'the odometry moved faster than any robot: is it in metres and radians?',
    'match_rejected': 'a scan does not fit what was seen before',
    'lost': 'it is not known where in the map the robot is: scans do not fit, or it has not been '
            'found yet'}
STEP_ACROSS_JUMP = 0.1     # [s] that is taken to pass between two runs, where time did not


class Session:
    """
    SLAM, and the pairing of scans and odometry before it.

    Parameters
    ----------
    config : parameters of the SLAM
    timeout : time [s] that a scan waits for its odometry
    count : called with the name of each fault, and its reason
    checkpoint : of an earlier run, to go on from
    background : loops are closed by another thread, see `Slam`
    capacity : scans that may wait at once
    start : name of this start, of which no other robot and no other start has the same
    how : how the run starts in the checkpoint's map
    odometry : whether there is any; else the motion is guessed from the matches

    """

    def __init__(self, config: SlamConfig, timeout: float, count: Callable[..., None],
                 checkpoint: Checkpoint | None = None, background: bool = True,
                 capacity: int = MAX_WAITING, start: str = '', how: Start = Start(),
                 odometry: bool = True) -> None:
        self._config, self._timeout, self._count = config, timeout, count
        self._background, self._capacity = background, capacity
        self._has_odometry = odometry
        self._lock = RLock()
        self._start, self._maps_begun = start, 0
        self.bodies = Bodies()    # of other robots, which are left out of the scans
        self.slam: Slam
        self._shift: float
        self._last_stamp: float
        self._resumed: bool
        self.reset()
        if checkpoint is not None:
            self._resume(checkpoint, how)

    @property
    def pairing(self) -> Pairing:
        """Scans and odometry on their way to the SLAM."""
        return self._pairing

    def reset(self) -> None:
        """Begin a new map, and forget what is on its way."""
        with self._lock:
            self._guess = None if self._has_odometry else MotionGuess()
            self._pairing = Pairing(self._timeout, self._count, self._begin_anew, self._capacity,
                                    self._guess)
            self._last_pose: Array | None = None
            self._orders = BeamOrders(self._count)
            self._new_map()

    def configure(self, config: SlamConfig) -> None:
        """Change the SLAM's parameters, for this map and those after it."""
        with self._lock:
            self._config = config
            self.slam.configure(config)

    def add_odometry(self, stamp: float, pose: Array, slip: Array | None = None) -> None:
        """Add T_odom_base (3,) at a stamp [s]."""
        with self._lock:
            self._pairing.add_odometry(stamp, pose, slip)

    def add_scan(self, scan: Scan, tag: Any, now: float) -> None:
        """Add a scan; the tag comes back with its step. now [s] is any steady time."""
        with self._lock:
            self._pairing.add_scan(scan, tag, now)

    def add_turn_rate(self, stamp: float, rate: float) -> None:
        """Take the turn rate [rad/s] of a gyroscope at a stamp [s]."""
        with self._lock:
            self._pairing.add_turn_rate(stamp, rate)

    def steps(self, now: float) -> Iterator[tuple[Any, Step]]:
        """Process the scans that odometry covers; yield each one's tag and step."""
        while True:
            with self._lock:
                self._pairing.odometry.lag = self.slam.odometry_lag
                paired = self._pairing.take(now)
                if paired is None:
                    return
                slam, scan = self._prepare(paired)
            yield self._process(slam, scan, paired)

    def finish(self) -> Iterator[tuple[Any, Step]]:
        """Process what still waits at the end of a log, with the odometry that there is."""
        for paired in self._pairing.finish():
            yield self._process(*self._prepare(paired), paired)
            self._pairing.odometry.lag = self.slam.odometry_lag

    def _prepare(self, paired: Paired) -> tuple[Slam, Scan]:
        """Return the SLAM that a scan is for, and the scan with a stamp later than all before."""
        scan, _, odometry = paired
        if self._resumed and scan.stamp <= self._last_stamp:
            self._rejoin(scan.stamp, odometry.pose)
        self._resumed = False
        stamp = scan.stamp + self._shift
        self._last_pose = odometry.pose
        self._last_stamp = max(self._last_stamp, stamp)
        return self.slam, replace(scan, stamp=stamp)

    def _process(self, slam: Slam, scan: Scan, paired: Paired) -> tuple[Any, Step]:
        """Process a scan; count what was wrong with it."""
        early = Early(scan, paired.odometry, self.bodies)
        scan = self._orders.mend(early, slam.config)
        if again := self._orders.again():
            slam = self._draw_anew(again)
        step = slam.process(scan, paired.odometry, self.bodies)
        if step.reason and not scan.fault():   # a fault was counted when the scan came
            self._count(step.reason, REASONS.get(step.reason, 'a scan was not used as it should'))
        if self._guess is not None:
            self._guess.learn(step, paired.odometry.twist, scan.sweep)
        with self._lock:
            self._pairing.gyro.learn(step, paired.odometry.stamp + self._pairing.odometry.lag)
        return paired.tag, step

    def _resume(self, checkpoint: Checkpoint, how: Start) -> None:
        """Go on from a checkpoint of an earlier run."""
        self.slam = Slam(self._config, background=self._background, checkpoint=checkpoint,
                         epoch=self.slam.epoch, start=how)
        self._last_stamp, odometry = self.slam.last_stamp, checkpoint.tracker.odometry
        self._orders.forget()   # a map that there was is not begun anew
        self._last_pose = None if odometry is None else odometry.pose
        self._resumed = True

    def _rejoin(self, stamp: float, pose: Array) -> None:
        """Go on from an earlier run whose time is later, with its map if the odometry goes on."""
        if self._last_pose is None or continued(self._last_pose, pose):
            self._shift = self._last_stamp + STEP_ACROSS_JUMP - stamp
        else:
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Begin a new map, as the odometry began anew at an earlier time."""
        self._count('maps_begun_anew', 'time and odometry both jumped')
        self._orders.forget()
        self._new_map()

    def _draw_anew(self, early: list[Early]) -> Slam:
        """Begin the map anew with its first scans, whose beams are now known to be in order."""
        with self._lock:
            shift, last = self._shift, self._last_stamp
            self._new_map()
            self._shift, self._last_stamp = shift, last
        for scan, odometry, bodies in early:
            self.slam.process(scan, odometry, bodies)
        return self.slam

    def _new_map(self) -> None:
        """Make a SLAM without a map."""
        epoch = Epoch(self._start, self._maps_begun)
        self._maps_begun += 1
        self.slam = Slam(self._config, background=self._background, epoch=epoch)
        self._shift, self._last_stamp = 0.0, -np.inf
        self._resumed = False
