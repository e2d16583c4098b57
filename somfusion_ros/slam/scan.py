# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One laser scan, and the points and surface normals that it saw."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

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

    @cached_property
    def bare(self) -> NDArray[np.bool_]:
        """Mask (N,) of the points without a normal."""
        return ~self.normals.any(1)


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
    reach = np.where(hit, ranges, np.where(beyond, limit, 0.0))
    beams = reach[:, None] * _directions(scan.angle_min, scan.angle_increment, len(ranges))
    placed = _deskew(apply(scan.T_base_laser, beams), scan.time_increment, twist)
    origin = np.array(scan.T_base_laser[:2])
    hits = placed[hit]
    points, joined = _thin(hits, _joined(hits, np.flatnonzero(hit), ranges[hit],
                                         abs(scan.angle_increment)))
    normals, noise = _surface(points, joined, origin)
    return Cloud(points, normals, *_walls(hits, np.flatnonzero(hit), ranges[hit]), origin,
                 _rim(placed, reach, origin), noise, scan.time_increment * len(ranges))


@lru_cache(maxsize=8)
def _directions(angle_min: float, angle_increment: float, beams: int) -> Array:
    """Give unit vectors (B, 2) along the beams in the laser frame, the same for every scan."""
    angles = angle_min + angle_increment * np.arange(beams)
    return np.column_stack([np.cos(angles), np.sin(angles)])


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
    step = points[1:] - points[:-1]
    return (beams[1:] - beams[:-1] <= 2) & (step[:, 0] ** 2 + step[:, 1] ** 2 < gap ** 2)


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
    rim = np.empty((1 + len(placed) + np.count_nonzero(jump), 2))
    index = np.arange(1, len(placed) + 1)
    index[1:] += jump.cumsum()
    rim[0], rim[index], rim[index[:-1][jump] + 1] = origin, placed, corner[jump]
    return rim
