# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""View-based SLAM of one robot: scans and odometry in, poses, map and trajectory out."""

from collections import Counter
from dataclasses import replace
from threading import Lock, RLock

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.bend import Bend
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.fixed_map import FixedMap
from somfusion_ros.slam.lost import Found, known_map, Lost
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.relocation import Placed
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.start import Start
from somfusion_ros.slam.step import Step

NOBODY, HERE = Bodies(), Start()
NO_STEP = Step(-np.inf, Pose(), np.zeros((3, 3)), Pose(), False, False, 0.0, False, '')
NOWHERE = np.diag([100.0, 100.0, np.pi]) ** 2   # covariance of a lost robot's pose


class Slam:
    """
    SLAM of one robot: scans with odometry in, poses and a map out.

    Parameters
    ----------
    config : SlamConfig, optional
        Parameters; `configure` changes them later.
    background : bool
        Whether somebody else closes loops, and looks for a lost robot, by calling `work` from
        another thread. Without, `process` does it, and the same input gives the same result.
    checkpoint : Checkpoint, optional
        What an earlier run ended with; this one goes on in its map.
    epoch : Epoch
        Which map a new one is to be.
    start : Start
        How the run starts in the checkpoint's map.

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
                 checkpoint: Checkpoint | None = None, epoch: Epoch = Epoch(),
                 start: Start = HERE) -> None:
        self.config, self.counters = config or SlamConfig(), Counter[str]()
        self.found, self.bend = list[Found](), Bend()   # the bend is of what is drawn only
        self._background, self._drawn, self._is_stale = background, start.drawn, False
        self._map_lock = Lock()   # guards the mapper
        self._switch = RLock()    # held while the robot is followed, becomes lost, is found
        self._map = (FixedMap(self.config, self.counters, checkpoint)
                     if start.localization and checkpoint is not None else
                     SingleMap(self.config, self.counters, checkpoint))
        self._mapper = Mapper(self.config.resolution, self.counters)
        self._last = None if start.anywhere else self._map.last
        self._lost: Lost | None = None if checkpoint is None else self._lose(self._last)
        self._map.graph.epoch = epoch if checkpoint is None else checkpoint.epoch_in(
            epoch, start.localization)

    def configure(self, config: SlamConfig) -> None:
        """Change the parameters; at another resolution the map is drawn anew."""
        self.config, lost = config, self._lost
        for part in [self._map, *([lost.piece] if lost else [])]:
            part.configure(config)
        with self._map_lock:
            if config.resolution != self._mapper.resolution:
                self._mapper = Mapper(self.config.resolution, self.counters)

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
        if fault := scan.fault() or odometry.fault() or self._stamp_fault(scan.stamp):
            return self._refuse(scan, fault)
        if self._lost is None:
            expected = compose(self._last.T_map_odom, odometry.pose) if self._last else Pose()
            scan = bodies.hide(scan, expected)
        seen = cloud(scan, self.config.max_laser_range, odometry.twist)
        with self._switch:
            if self._lost and self._lost.went_on(self._map.tracker, odometry):
                self._lost = None    # as after a gap between scans
            step = self._last = self._follow(scan.stamp, seen, odometry)
        while not self._background and self.work():
            continue
        return step

    def work(self) -> bool:
        """Close one waiting view's loops, or look for a lost robot; return whether it did."""
        lost = self._lost
        if lost is None:
            return self._map.closer.work()
        if lost.piece.closer.work():
            return True
        if not lost.due:
            return False
        placed = lost.look()
        with self._switch:
            if placed is not None and self._lost is lost:
                self._join(lost, *placed)
        return True

    def relocate(self, pose: ArrayLike, P: Array) -> None:
        """Believe that the robot is at a pose T_map_base (3,) with covariance P (3, 3)."""
        with self._switch:
            tracker = self._lost.piece.tracker if self._lost else None
            if self._map.graph.clouds:
                self._map.stand(np.asarray(pose, float), P, tracker)
                self._lost = None

    @property
    def lost(self) -> str:
        """Why a lost robot is not found yet, in words; '' where it is not lost."""
        lost = self._lost    # read once, everywhere: another thread may find the robot
        return lost.reason if lost else ''

    def grid(self, most: int | None = None, anew: bool = False) -> Grid:
        """Return the map at the poses held now, drawn anew if asked; most: `Mapper.render`'s."""
        if self._drawn is not None:
            return self._drawn
        anew, self._is_stale = anew or self._is_stale, False
        scans, poses = self._map.drawn()
        with self._map_lock:
            if anew:
                self._mapper = Mapper(self.config.resolution, self.counters)
            return self._mapper.render(scans, self.bend.views(poses), most)

    def views(self) -> tuple[Array, Array]:
        """Return stamps (n,) and poses T_map_base (n, 3) of the views, corrected by all loops."""
        return self._map.views()

    def trajectory(self) -> tuple[Array, Array]:
        """Return the stamps (m,) and poses T_map_base (m, 3) of every scan used, corrected."""
        return self._map.trajectory()

    def driven(self) -> tuple[Array, Array]:
        """Return stamps (m,), poses (m, 3) of this run's scans in the map, else in the piece."""
        lost, (stamps, poses) = self._lost, self._map.trajectory()
        before = self._map.graph.trail.before
        if lost is not None and len(stamps) == before:   # it was lost from the start
            return lost.piece.trajectory()
        return stamps[before:], poses[before:]

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
        return self._last.stamp if self._last else -np.inf

    @property
    def odometry_lag(self) -> float:
        """Time [s] to add to a scan's stamp to find the odometry that belongs to it."""
        lost = self._lost
        return (lost.piece if lost else self._map).tracker.calibration.lag

    @property
    def pose_sigma(self) -> tuple[float, float, float]:
        """Standard deviations of the current pose [m, m, rad]."""
        x, y, theta = np.sqrt(np.diag((self._last or NO_STEP).covariance)).tolist()
        return x, y, theta

    def _follow(self, stamp: float, seen: Cloud, odometry: Odometry) -> Step:
        """Follow the robot in its map; where it is lost, in a piece of map apart."""
        if self._lost is None:
            step = self._map.follow(stamp, seen, odometry)
            if not self._map.astray:
                return step
            self._is_stale = True    # what is drawn, as views were taken back
        lost = self._lost = self._lost or self._lose()
        lost.drive(odometry)
        step = lost.piece.follow(stamp, seen, odometry)
        T_map_odom = self._last.T_map_odom if self._last else Pose()
        return replace(step, pose=Pose.from_array(compose(T_map_odom, odometry.pose)),
                       covariance=NOWHERE, T_map_odom=T_map_odom, matched=False, is_view=False,
                       reason='lost')

    def _lose(self, stood: Step | None = None) -> Lost:
        """Begin a piece of map apart; stood: where the robot may still be."""
        return Lost(self.config, self.counters, lambda: known_map(self._map, self.grid()), stood,
                    self._map.tracker.calibration, self._map.astray)

    def _join(self, lost: Lost, view: int, placed: Placed) -> None:
        """Go on in the map where a view of the piece was found."""
        T_map_piece = lost.join(self._map, view, placed)
        if lost.moved:
            self.found.append(Found(self.last_stamp, lost.metres, T_map_piece))
        self._lost = None

    def _stamp_fault(self, stamp: float) -> str:
        """Name a stamp that repeats or runs backward."""
        return '' if stamp > self.last_stamp else (
            'scan_stamps_repeated' if stamp == self.last_stamp else 'scan_stamps_backward')

    def _refuse(self, scan: Scan, reason: str) -> Step:
        """Count a scan that cannot be used."""
        self.counters[reason] += 1
        return replace(self._last or NO_STEP, stamp=scan.stamp, accepted=False, matched=False,
                       inlier_ratio=0.0, is_view=False, reason=reason, moved=None)
