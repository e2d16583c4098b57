# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""This package's SLAM, and those that pip installs beside it, behind one interface."""

from math import cos, sin
from typing import Protocol

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import cloud, Scan
from somfusion_ros.slam.slam import Slam

MAX_RANGE = 30.0          # [m] this package's default, for all
VOXEL = 0.1               # [m] of kiss-icp; 0.05 and 0.2 do worse on the logs with relations
TRAVEL = (0.2, 0.2)       # [m] [rad] after which Karto's kind processes the next scan


class System(Protocol):
    """
    What a log is replayed through; `beside` is what need not delay a scan.

    lag [s] is what the system knows of the time between a scan's stamp and its odometry's.
    """

    lag: float

    def process(self, scan: Scan, odometry: Odometry) -> bool:
        """Follow the robot through one scan; return whether it was looked at."""

    def beside(self) -> None:
        """Do all that is waiting."""

    def draw(self) -> None:
        """Draw the map, where there is one."""

    def trajectory(self) -> tuple[Array, Array]:
        """Stamps (n,) [s] and poses T_map_base (n, 3), as known at the end."""


class Own:
    """This package, in its default configuration."""

    def __init__(self) -> None:
        self.slam = Slam(background=True)

    def process(self, scan: Scan, odometry: Odometry) -> bool:
        """Follow the robot through one scan."""
        self.slam.process(scan, odometry)
        return True

    def beside(self) -> None:
        """Close the loops that are waiting."""
        while self.slam.work():
            pass

    def draw(self) -> None:
        """Draw the map."""
        self.slam.grid()

    @property
    def lag(self) -> float:
        """Time [s] by which the odometry belongs to a later moment."""
        return self.slam.odometry_lag

    def trajectory(self) -> tuple[Array, Array]:
        """Stamps and poses of every scan used."""
        return self.slam.trajectory()


class Kiss:
    """kiss-icp's own pipeline, with the odometry's step in place of its constant velocity."""

    lag = 0.0

    def __init__(self) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
        config = KISSConfig()
        config.data.max_range, config.data.deskew = MAX_RANGE, False
        config.mapping.voxel_size = VOXEL
        config.registration.max_num_threads = 1
        config.adaptive_threshold.initial_threshold = 0.5
        self._icp, self._last = KissICP(config), None
        self._stamps, self._poses = [], []

    def process(self, scan: Scan, odometry: Odometry) -> bool:
        """Register one scan."""
        if self._last is not None:
            self._icp.last_delta = _lifted(between(self._last, odometry.pose))
        hits = cloud(scan, MAX_RANGE).outline.hits
        self._icp.register_frame(np.column_stack([hits, np.zeros(len(hits))]), np.zeros(0))
        self._last, T = odometry.pose, self._icp.last_pose
        self._stamps.append(scan.stamp)
        self._poses.append((T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])))
        return True

    def beside(self) -> None:
        """Nothing: it closes no loops."""

    def draw(self) -> None:
        """Nothing: it keeps no map."""

    def trajectory(self) -> tuple[Array, Array]:
        """Stamps and poses of every scan."""
        return np.array(self._stamps), np.array(self._poses)


class Yag:
    """yag-slam, Karto in Python and C++, untuned."""

    lag = 0.0

    def __init__(self) -> None:
        from yag_slam.graph_slam import GraphSlam
        from yag_slam.helpers import default_config, default_config_loop
        from yag_slam.scan_matching import Scan2DMatcherCpp
        self._slam = GraphSlam(Scan2DMatcherCpp(default_config),
                               Scan2DMatcherCpp(default_config_loop, loop=True))
        self._track: list[tuple[float, int, Array]] = []    # stamp, vertex, T_vertex_base
        self._last: Array | None = None

    def process(self, scan: Scan, odometry: Odometry) -> bool:
        """Match and add a scan once the robot has moved; keep to the odometry between."""
        step = np.zeros(3) if self._last is None else between(self._last, odometry.pose)
        new = bool(self._last is None or np.hypot(step[0], step[1]) >= TRAVEL[0]
                   or abs(step[2]) >= TRAVEL[1])
        if new:
            self._slam.process_scan(self._range_scan(scan, odometry))
            self._last, step = odometry.pose, np.zeros(3)
        self._track.append((scan.stamp, len(self._slam.graph.vertices) - 1, step))
        return new

    def _range_scan(self, scan: Scan, odometry: Odometry) -> object:
        from yag_slam.models import LocalizedRangeScan
        self._T_laser_base = inverse(scan.T_base_laser)
        returned = (scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max)
        ranges = np.where(returned, scan.ranges, 2.0 * MAX_RANGE)   # beyond its range_threshold
        last = scan.angle_min + scan.angle_increment * (len(ranges) - 1)
        return LocalizedRangeScan(ranges.tolist(), scan.angle_min, last, scan.angle_increment,
                                  scan.range_min, scan.range_max,
                                  min(MAX_RANGE, 0.99 * scan.range_max),
                                  *compose(odometry.pose, scan.T_base_laser))

    def beside(self) -> None:
        """Nothing: its loops are closed within `process_scan`."""

    def draw(self) -> None:
        """Draw the map."""
        self._slam.make_occupancy_grid(0.05, MAX_RANGE)

    def trajectory(self) -> tuple[Array, Array]:
        """Stamps and poses of every scan; those between vertices hang on the last."""
        at = [v.obj.corrected_pose for v in self._slam.graph.vertices]
        vertices = compose(np.array([(p.x, p.y, p.euler[-1]) for p in at]), self._T_laser_base)
        stamps, k, hung = zip(*self._track, strict=True)
        return np.array(stamps), compose(vertices[list(k)], np.array(hung))


SYSTEMS = {'somfusion_ros': Own, 'kiss-icp, odometry seed': Kiss, 'yag-slam': Yag}


def missing(name: str) -> str:
    """Say why a system cannot run here; '' if it can."""
    try:
        SYSTEMS[name]()
    except ImportError as error:
        return f'not installed ({error})'
    return ''


def _lifted(pose: Array) -> Array:
    """Planar pose (3,) as a transform (4, 4) of space."""
    c, s, T = cos(pose[2]), sin(pose[2]), np.eye(4)
    T[:2, :2], T[:2, 3] = ((c, -s), (s, c)), pose[:2]
    return T
