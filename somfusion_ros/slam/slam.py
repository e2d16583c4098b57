# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""View-based SLAM of one robot: scans and odometry in, poses, map and trajectory out."""

from collections import Counter
from threading import Lock

import numpy as np
from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import cloud, Scan
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.step import Step

NOBODY = Bodies()


class Slam:
    """
    SLAM of one robot: scans with odometry in, poses and a map out.

    `process` is the scan path: its time does not depend on how many views there are.

    Parameters
    ----------
    config : SlamConfig, optional
        Parameters; `configure` changes them later.
    background : bool
        Whether somebody else closes loops by calling `work`, from another thread. Without,
        `process` does it, and the same input gives the same result.
    checkpoint : Checkpoint, optional
        What an earlier run ended with; this one goes on from it.
    epoch : Epoch
        Which map a new one is to be.

    Examples
    --------
    A robot stands in the middle of a room of 4 x 4 m, then drives 0.5 m ahead:

    >>> from somfusion_ros.slam.motion import Odometry
    >>> from somfusion_ros.slam.scan import Scan
    >>> from somfusion_ros.simulation.floor_plan import box
    >>> from somfusion_ros.simulation.raycast import raycast
    >>> slam, angles = Slam(), np.radians(np.arange(360.0))
    >>> for k, x in enumerate((0.0, 0.25, 0.5)):
    ...     ranges, _ = raycast(box(0.0, 0.0, 4.0, 4.0), np.tile((x, 0.0), (360, 1)), angles)
    ...     scan = Scan(0.1 * k, ranges, 0.0, np.radians(1.0), 0.1, 10.0)
    ...     step = slam.process(scan, Odometry(0.1 * k, np.array((x, 0.0, 0.0)), np.zeros(3)))
    >>> step.matched, round(step.pose.x, 1)
    (True, 0.5)
    >>> slam.grid().resolution
    0.05
    """

    def __init__(self, config: SlamConfig | None = None, background: bool = False,
                 checkpoint: Checkpoint | None = None, epoch: Epoch = Epoch()) -> None:
        self.config = config or SlamConfig()
        self.counters: Counter[str] = Counter()
        self._background = background
        self._map_lock = Lock()        # guards the mapper
        self._map = SingleMap(self.config, self.counters)
        self._mapper = Mapper(self.config.resolution)
        if checkpoint is not None:
            self._map.resume(checkpoint)
        if not self._map.graph.epoch.start:   # the map is new, or was made offline
            self._map.graph.epoch = epoch

    def configure(self, config: SlamConfig) -> None:
        """Change the parameters; at another resolution the map is drawn anew."""
        self.config = config
        self._map.configure(config)
        with self._map_lock:
            if config.resolution != self._mapper.resolution:
                self._mapper = Mapper(config.resolution)

    def process(self, scan: Scan, odometry: Odometry, bodies: Bodies = NOBODY) -> Step:
        """
        Follow the robot through one scan.

        Parameters
        ----------
        scan : Scan
            What the laser saw, with its mount.
        odometry : Odometry
            Where the wheels have the robot at the scan's stamp.
        bodies : Bodies
            Other robots, which are left out of what was seen.

        Returns
        -------
        Step
            Pose and covariance after the scan. Bad input is counted in `counters`, named in the
            step's reason, and changes nothing.
        """
        self.counters['scans'] += 1
        fault = scan.fault() or odometry.fault() or self._stamp_fault(scan.stamp)
        if fault:
            return self._refuse(scan, fault)
        last = self._map.last
        expected = compose(last.T_map_odom, odometry.pose) if last else Pose()
        seen = cloud(bodies.hide(scan, expected), self.config.max_laser_range, odometry.twist)
        step = self._map.follow(scan.stamp, seen, odometry)
        while not self._background and self.work():
            pass
        return step

    def work(self) -> bool:
        """Try to close one waiting view's loops; return whether there was one."""
        return self._map.work()

    def grid(self) -> Grid:
        """Return the map at the poses held now; slow after a loop, so not for the scan path."""
        scans, poses = self._map.drawn()
        with self._map_lock:
            return self._mapper.render(scans, poses)

    def views(self) -> tuple[Array, Array]:
        """Return stamps (n,) and poses T_map_base (n, 3) of the views, corrected by all loops."""
        return self._map.views()

    def trajectory(self) -> tuple[Array, Array]:
        """Return the stamps (m,) and poses T_map_base (m, 3) of every scan used, corrected."""
        return self._map.trajectory()

    def checkpoint(self) -> Checkpoint:
        """Return what a later run can go on from."""
        return self._map.checkpoint()

    @property
    def epoch(self) -> Epoch:
        """Which map it is: a checkpoint's, or the one that was begun."""
        return self._map.graph.epoch

    @property
    def last_stamp(self) -> float:
        """Stamp [s] of the last scan used; -inf before the first."""
        return self._map.last.stamp if self._map.last else -np.inf

    @property
    def odometry_lag(self) -> float:
        """Time [s] to add to a scan's stamp to find the odometry that belongs to it."""
        return self._map.tracker.calibration.lag

    @property
    def pose_sigma(self) -> tuple[float, float, float]:
        """Standard deviations of the current pose [m, m, rad]."""
        if self._map.last is None:
            return 0.0, 0.0, 0.0
        x, y, theta = np.sqrt(np.diag(self._map.last.covariance)).tolist()
        return x, y, theta

    def _stamp_fault(self, stamp: float) -> str:
        """Name a stamp that repeats or runs backward."""
        if stamp > self.last_stamp:
            return ''
        return 'scan_stamps_repeated' if stamp == self.last_stamp else 'scan_stamps_backward'

    def _refuse(self, scan: Scan, reason: str) -> Step:
        """Count a scan that cannot be used."""
        self.counters[reason] += 1
        last = self._map.last
        return Step(scan.stamp, last.pose if last else Pose(),
                    last.covariance if last else np.zeros((3, 3)),
                    last.T_map_odom if last else Pose(), False, False, 0.0, False, reason)
