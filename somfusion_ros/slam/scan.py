# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One laser scan, and the points and surface normals that it saw."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import apply, Array, Pose

SPACING = 0.04      # [m] of surface that one point stands for, where the beams are denser
SURFACE_GAP = 0.15  # [m] neighbouring returns farther apart than this, at 1 m, are two surfaces
STRAIGHT = 0.1      # [m] by which neighbouring returns on one wall may miss its line
FILLED = 1.0        # [m] widest gap between two returns on one wall that is drawn as wall


@dataclass(frozen=True, eq=False)
class Scan:
    """
    A planar laser scan (sensor_msgs/LaserScan, REP-117).

    stamp [s] of the first beam, ranges (B,) [m], angles [rad] in the laser frame, range limits
    [m], time_increment [s] between beams, and the laser's mount on the robot.
    """

    stamp: float
    ranges: NDArray[np.floating]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float = 0.0
    T_base_laser: Pose = field(default_factory=Pose)

    def fault(self) -> str:
        """Name what makes the scan unusable, '' if nothing does."""
        numbers = (self.stamp, self.angle_min, self.angle_increment, self.range_min,
                   self.time_increment, *self.T_base_laser)
        if not np.isfinite(numbers).all() or np.isnan(self.range_max):
            return 'scan_not_finite'
        if np.ndim(self.ranges) != 1 or len(self.ranges) < 2:
            return 'scan_empty'
        if self.angle_increment == 0.0 or self.range_max <= self.range_min:
            return 'scan_geometry_invalid'
        return ''


@dataclass(frozen=True, eq=False)
class Cloud:
    """
    What a scan saw, in the robot's base frame at the scan's stamp.

    points (N, 2) [m] along the surfaces, normals (N, 2) facing the laser (zero where there is
    too little surface), hits (K, 2) every return and the wall between them, walls (2 L, 2) the
    two ends of each piece of surface between neighbouring returns, origin (2,) of the laser,
    rim (M, 2): the polygon of the space that the beams passed, closed through the origin; noise:
    scatter [m] of the points about their surfaces, sweep [s]: time from the first beam to the
    last, 0 where it is not known.
    """

    points: Array
    normals: Array
    hits: Array
    walls: Array
    origin: Array
    rim: Array
    noise: float = 0.0
    sweep: float = 0.0

    def __len__(self) -> int:
        return len(self.points)


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
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    limit = min(max_range, scan.range_max)
    with np.errstate(invalid='ignore'):
        hit = (ranges >= max(scan.range_min, 1e-3)) & (ranges < limit)
        beyond = (ranges >= limit) & (np.isposinf(ranges) | (ranges < scan.range_max))
    reach = np.where(hit, ranges, np.where(beyond, limit, 0.0))
    beams = reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    placed = _deskew(apply(scan.T_base_laser, beams), scan.time_increment, twist)
    origin = np.array(scan.T_base_laser[:2])
    hits = placed[hit]
    points, joined = _thin(hits, _joined(hits, np.flatnonzero(hit), ranges[hit],
                                         abs(scan.angle_increment)))
    normals, noise = _surface(points, joined, origin)
    return Cloud(points, normals, *_walls(hits, np.flatnonzero(hit), ranges[hit]), origin,
                 _rim(placed, reach, origin), noise, scan.time_increment * len(ranges))


def _joined(points: Array, beams: NDArray[np.intp], ranges: Array, increment: float
            ) -> NDArray[np.bool_]:
    """
    Tell which neighbouring returns (N - 1,) continue one surface.

    They do while no beam is missing, and the gap is no wider than a surface seen at a grazing
    angle would leave between two beams.
    """
    if len(points) < 2:
        return np.zeros(0, bool)
    gap = SURFACE_GAP * np.maximum(1.0, np.minimum(ranges[1:], ranges[:-1]) * increment * 40.0)
    return (np.diff(beams) <= 2) & ((np.diff(points, axis=0) ** 2).sum(1) < gap ** 2)


def _thin(points: Array, joined: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Average returns (N, 2) over SPACING of surface; return points and which are joined."""
    if len(points) < 2:
        return points, joined
    step = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.where(joined, step, 0.0).cumsum()])
    surface = np.concatenate([[0], (~joined).cumsum()])
    start = along[np.flatnonzero(np.concatenate([[True], ~joined]))][surface]
    piece = np.floor((along - start) / SPACING)
    new = (np.diff(piece) != 0) | ~joined
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    count = np.diff(np.concatenate([first, [len(points)]]))
    return np.add.reduceat(points, first) / count[:, None], joined[first[1:] - 1]


def _deskew(points: Array, time_increment: float, twist: Array | None) -> Array:
    """Move each beam's point (B, 2) from the base where it was taken to the base at beam 0."""
    if time_increment == 0.0 or twist is None:
        return points
    t = time_increment * np.arange(len(points))
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
    count, first = np.ones(n), np.zeros((n, 2))
    second = np.zeros((n, 3))
    for direction in (1, -1):
        alive = np.ones(n, dtype=bool)
        for k in range(1, reach + 1):
            index = np.arange(n) + direction * k
            link = np.clip(index - (direction > 0), 0, n - 2)
            alive &= (index >= 0) & (index < n) & joined[link]
            d = np.where(alive[:, None], points[np.clip(index, 0, n - 1)] - points, 0.0)
            count += alive
            first += d
            second += np.column_stack([d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2])
    mean = first / count[:, None]
    xx, xy, yy = (second / count[:, None]).T - np.array(
        [mean[:, 0] ** 2, mean[:, 0] * mean[:, 1], mean[:, 1] ** 2])
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy ** 2)
    flat = (count >= 4) & (spread > 0.8 * (xx + yy))
    normals = np.column_stack([-np.sin(angle), np.cos(angle)])
    normals[((origin - points) * normals).sum(1) < 0] *= -1
    normals = np.where(flat[:, None], normals, 0.0)
    across = np.maximum(0.5 * (xx + yy - spread), 0.0)[flat] * count[flat] / (count[flat] - 2.0)
    return normals, float(np.sqrt(np.median(across))) if flat.any() else 0.0


def _walls(hits: Array, beams: NDArray[np.intp], ranges: Array) -> tuple[Array, Array]:
    """
    Fill the wall between returns (N, 2) that a grazing beam leaves bare; see `Cloud`.

    Two neighbouring returns lie on one surface where their ranges differ little, and on one wall
    where a third continues their line: far down a corridor they may be metres apart.
    """
    if len(hits) < 2:
        return hits, np.zeros((0, 2))
    step = np.diff(hits, axis=0)
    gap = np.maximum(np.hypot(*step.T), 1e-9)
    u = step / gap[:, None]
    short, wide = np.minimum(gap[1:], gap[:-1]), np.maximum(gap[1:], gap[:-1])
    bend = np.abs(u[1:, 0] * u[:-1, 1] - u[1:, 1] * u[:-1, 0])
    line = ((bend * short < STRAIGHT) & ((u[1:] * u[:-1]).sum(1) > 0.7)
            & (wide < 3.0 * short + 2.0 * STRAIGHT))
    wall = np.zeros(len(gap), bool)
    wall[1:] |= line
    wall[:-1] |= line
    neighbours = np.diff(beams) <= 2
    wall &= neighbours
    one = wall | neighbours & ~_jumps(ranges[:-1], ranges[1:])
    bare = np.where(wall & (gap < FILLED), gap // SPACING, 0.0).astype(np.intp)
    piece = np.repeat(np.arange(len(gap)), bare)
    part = 1.0 + np.arange(len(piece)) - (np.cumsum(bare) - bare)[piece]
    between = hits[piece] + (part / (bare[piece] + 1.0))[:, None] * step[piece]
    ends = np.stack([hits[:-1], hits[1:]], axis=1)[one].reshape(-1, 2)
    return np.concatenate([hits, between]), ends


def _jumps(one: Array, other: Array) -> NDArray[np.bool_]:
    """Tell where the ranges of two neighbouring beams differ as on two surfaces."""
    return np.maximum(one, other) > 1.2 * np.minimum(one, other) + 0.1


def _rim(placed: Array, reach: Array, origin: Array) -> Array:
    """
    Outline (M, 2) of the space the beams passed.

    Between two beams on one surface the outline is the surface; where the range jumps, the
    nearer range holds up to the middle, so that no beam frees what it did not pass.
    """
    near, jump = np.minimum(reach[:-1], reach[1:]), _jumps(reach[:-1], reach[1:])
    half = 0.5 * (placed[:-1] + placed[1:]) - origin
    length = np.maximum(np.hypot(half[:, 0], half[:, 1]), 1e-9)
    corner = origin + half * (near / length)[:, None]
    order = np.concatenate([np.arange(len(placed), dtype=float), np.flatnonzero(jump) + 0.5])
    return np.concatenate([[origin], np.concatenate([placed, corner[jump]])[np.argsort(order)]])
