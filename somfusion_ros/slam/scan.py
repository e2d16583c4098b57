# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One laser scan, and the points and surface normals that it saw."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, Pose
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.surface import Surface

SPACING = 0.04      # [m] of surface that one point stands for, where the beams are denser
SURFACE_GAP = 0.15  # [m] neighbouring returns farther apart than this, at 1 m, are two surfaces
LEAP = 3.0          # times the narrower gap beside it: returns so far apart are two surfaces
LONGEST_SWEEP = 1.0  # [s] from first to last beam that a real laser takes


@dataclass(frozen=True, eq=False)
class Scan:
    """
    A planar laser scan (sensor_msgs/LaserScan, REP-117).

    stamp [s] of the first beam, ranges (B,) [m], angles [rad] in the laser frame, range limits
    [m], time_increment [s] between beams, negative where they were taken in falling order (the
    stamp is then that of the last beam), and the laser's mount on the robot. open_reach (B,) [m]:
    how far a beam without a return frees space, None: as far as the laser reaches. laser: a name
    of the laser that took it; odd: what had to be mended in the message. begins: share of the
    beams, as listed, that lies before the place where the sweep began.
    """

    stamp: float
    ranges: NDArray[np.floating]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float = 0.0
    T_base_laser: Pose = field(default_factory=Pose)
    open_reach: Array | None = None
    laser: str = ''
    odd: str = ''
    begins: float = 0.0

    @property
    def sweep(self) -> float:
        """Time [s] that all beams take; 0 where it is not known."""
        return abs(self.beam_time) * len(self.ranges)

    @property
    def beam_time(self) -> float:
        """Time [s] from beam to beam, negative in falling order; 0 where it is not known."""
        possible = abs(self.time_increment) * len(self.ranges) < LONGEST_SWEEP
        return self.time_increment if possible else 0.0

    @property
    def beam_times(self) -> Array | None:
        """Time (B,) [s] of every beam after the first in time; None where it is not known."""
        n, each = len(self.ranges), self.beam_time
        if each == 0.0:
            return None
        rank = np.arange(n) if each > 0.0 else np.arange(n)[::-1]
        first = round(self.begins * n)
        return abs(each) * ((rank - (first if each > 0.0 else n - first)) % n)

    def fault(self) -> str:
        """Name what makes the scan unusable, '' if nothing does."""
        numbers = (self.stamp, self.angle_min, self.angle_increment, self.range_min,
                   *self.T_base_laser)
        if not np.isfinite(numbers).all() or np.isnan(self.range_max):
            return 'scan_not_finite'
        if np.ndim(self.ranges) != 1 or len(self.ranges) < 2:
            return 'scan_empty'
        if self.angle_increment == 0.0 or self.range_max <= self.range_min:
            return 'scan_geometry_invalid'
        return ''


@dataclass(frozen=True, eq=False)
class Cloud(Surface):
    """
    What a scan saw, in the robot's base frame at the scan's stamp.

    points (N, 2) [m] along the surfaces, normals (N, 2) facing the laser (zero where there is
    too little surface), the outline of what is drawn; noise: scatter [m] of the points about
    their surfaces, sweep [s]: time from the first beam to the last, 0 where it is not known;
    spacing [m] of neighbouring points on a surface.
    """

    points: Array
    normals: Array
    outline: Outline = field(default_factory=Outline)
    noise: float = 0.0
    sweep: float = 0.0
    spacing: float = SPACING


def cloud(scan: Scan, max_range: float, twist: Array | None = None) -> Cloud:
    """
    Convert a scan: drop what is no return, deskew, thin, estimate normals, outline free space.

    Parameters
    ----------
    scan : the scan, without a fault
    max_range : returns beyond it [m] are not used
    twist : (3,) speed of the base [m/s, m/s, rad/s], used where time_increment is set
    """
    ranges = np.asarray(scan.ranges, dtype=float)
    limit = min(max_range, scan.range_max)
    with np.errstate(invalid='ignore'):
        hit = (ranges >= max(scan.range_min, 1e-3)) & (ranges < limit)
        beyond = (ranges >= limit) & (np.isposinf(ranges) | (ranges < scan.range_max))
    free = limit if scan.open_reach is None else np.where(
        np.isposinf(ranges), np.minimum(scan.open_reach, limit), limit)
    reach = np.where(hit, ranges, np.where(beyond, free, 0.0))
    beams = reach[:, None] * _directions(scan.angle_min, scan.angle_increment, len(ranges))
    placed = _deskew(apply(scan.T_base_laser, beams), scan.beam_times, twist)
    origin = np.array(scan.T_base_laser[:2])
    hits = placed[hit]
    points, joined = _thin(hits, _joined(hits, np.flatnonzero(hit), ranges[hit],
                                         abs(scan.angle_increment)))
    normals, noise = _surface(points, joined, origin)
    outline = Outline(placed.astype(np.float32), reach.astype(np.float32), hit, origin)
    return Cloud(points, normals, outline, noise, scan.sweep, _spacing(points, joined))


@lru_cache(maxsize=8)
def _directions(angle_min: float, angle_increment: float, beams: int) -> Array:
    """Return unit vectors (B, 2) along the beams in the laser frame, the same for every scan."""
    angles = angle_min + angle_increment * np.arange(beams)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _joined(points: Array, beams: NDArray[np.intp], ranges: Array, increment: float
            ) -> NDArray[np.bool_]:
    """
    Tell which neighbouring returns (N - 1,) continue one surface.

    They do while no beam is missing, and the gap is no wider than a surface seen at a grazing
    angle would leave between two beams. Such a gap is not much wider than those beside it: far
    away, a leap from one wall to another would turn the normals of both.
    """
    if len(points) < 2:
        return np.zeros(0, bool)
    gap = SURFACE_GAP * np.maximum(1.0, np.minimum(ranges[1:], ranges[:-1]) * increment * 40.0)
    step = np.hypot(*(points[1:] - points[:-1]).T)
    beside = np.pad(step, 1, constant_values=np.inf)
    leap = step > np.maximum(SURFACE_GAP, LEAP * np.minimum(beside[:-2], beside[2:]))
    joined: NDArray[np.bool_] = (beams[1:] - beams[:-1] <= 2) & (step < gap) & ~leap
    return joined


def _thin(points: Array, joined: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Average returns (N, 2) over SPACING of surface; return points and which are joined."""
    if len(points) < 2:
        return points, joined
    step = points[1:] - points[:-1]
    along = np.zeros(len(points))
    np.cumsum(np.where(joined, np.hypot(step[:, 0], step[:, 1]), 0.0), out=along[1:])
    ends = np.flatnonzero(~joined) + 1
    surfaces = np.concatenate([[0], ends, [len(points)]])
    start = along[surfaces[:-1]].repeat(surfaces[1:] - surfaces[:-1])
    piece = np.floor((along - start) / SPACING)
    first = np.flatnonzero((piece[1:] != piece[:-1]) | ~joined) + 1
    first = np.concatenate([[0], first])
    count = np.diff(first, append=len(points))
    return np.add.reduceat(points, first) / count[:, None], joined[first[1:] - 1]


def _spacing(points: Array, joined: NDArray[np.bool_]) -> float:
    """Return the median distance [m] of neighbouring points (N, 2) on one surface."""
    step = np.diff(points, axis=0)[joined]
    return float(np.median(np.hypot(step[:, 0], step[:, 1]))) if len(step) else SPACING


def _deskew(points: Array, t: Array | None, twist: Array | None) -> Array:
    """Move points (B, 2) from the bases t (B,) [s] after the stamp to that at the stamp."""
    if t is None or twist is None:
        return points
    c, s = np.cos(twist[2] * t), np.sin(twist[2] * t)
    return np.column_stack([c * points[:, 0] - s * points[:, 1] + twist[0] * t,
                            s * points[:, 0] + c * points[:, 1] + twist[1] * t])


def _surface(points: Array, joined: NDArray[np.bool_], origin: Array,
             reach: int = 4) -> tuple[Array, float]:
    """
    Fit a line to each point (N, 2) and up to `reach` neighbours on each side.

    Returns the lines' unit normals (N, 2), zero where the surface is not flat, and the scatter
    [m] of the points about their lines.
    """
    n = len(points)
    if n < 3:
        return np.zeros((n, 2)), 0.0
    x, y = points.T
    sums, alive = np.zeros((6, n)), np.ones(n, bool)    # 1, x, y, xx, xy, yy of the neighbours
    sums[0] = 1.0
    for k in range(1, min(reach, n - 1) + 1):
        alive = alive[:-1] & joined[k - 1:]
        dx, dy = (x[k:] - x[:-k]) * alive, (y[k:] - y[:-k]) * alive
        terms = np.array([alive, dx, dy, dx * dx, dx * dy, dy * dy])
        sums[:, :-k] += terms
        terms[1:3] *= -1.0
        sums[:, k:] += terms
    count = sums[0]
    mx, my, xx, xy, yy = sums[1:] / count
    xx, xy, yy = xx - mx * mx, xy - mx * my, yy - my * my
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy ** 2)
    flat = (count >= 4) & (spread > 0.8 * (xx + yy))
    normals = np.column_stack([-np.sin(angle), np.cos(angle)])
    facing = (origin[0] - x) * normals[:, 0] + (origin[1] - y) * normals[:, 1]
    normals *= (np.where(facing < 0, -1.0, 1.0) * flat)[:, None]
    across = np.maximum(0.5 * (xx + yy - spread), 0.0)[flat] * count[flat] / (count[flat] - 2.0)
    return normals, float(np.sqrt(np.median(across))) if len(across) else 0.0
