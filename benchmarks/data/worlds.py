# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made from maps: bent, worn, cut, mirrored, scaled, and as other sensors draw them."""

from collections.abc import Callable

from benchmarks.data.renovations import emptied
import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, compose, inverse, Pose
from somfusion_ros.grid import Grid

Random = np.random.Generator
Warped = Callable[[Array], Array]


def bend(grid: Grid, degrees: float, rng: Random) -> tuple[Grid, Warped]:
    """
    Bend a map as drift does, by an angle over its length.

    Returns the bent map, and the function that takes points of the straight map to it.
    """
    rows, columns = np.nonzero(grid.free)
    local = np.column_stack([columns, rows])[::7] * grid.resolution
    size, centre = np.ptp(np.percentile(local, [5, 95], axis=0), axis=0), local.mean(0)
    u = np.eye(2)[size.argmax()]
    v, k = np.array([-u[1], u[0]]), np.radians(degrees) / size.max() * rng.choice([-1, 1])

    (ux, uy), (vx, vy), (cx, cy), curve = u.tolist(), v.tolist(), centre.tolist(), float(k)

    def straighten(x: Array, y: Array) -> tuple[Array, Array]:
        s, t = (x - cx) * ux + (y - cy) * uy, (x - cx) * vx + (y - cy) * vy
        s, t = s + curve * s * t, t - 0.5 * curve * s * s
        return cx + s * ux + t * vx, cy + s * uy + t * vy

    def bent(points: Array) -> Array:
        wanted = apply(inverse(grid.T_frame_grid), points)
        found = wanted
        for _ in range(8):
            found = found + wanted - np.column_stack(straighten(*found.T))
        return apply(grid.T_frame_grid, found)
    row, column = _cells(grid)
    at = straighten((column + 0.5) * grid.resolution, (row + 0.5) * grid.resolution)
    x, y = (np.asarray(axis / grid.resolution - 0.5, np.float32) for axis in at)
    evidence = cv2.remap(grid.evidence, x, y, cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid), bent


def worn(grid: Grid, rng: Random, shake: float = 0.5, lost: float = 0.1,
         specks: float = 0.0005) -> Grid:
    """Lose a share of the walls, add specks, and shake walls by about `shake` cells."""
    evidence, chance = grid.evidence.copy(), rng.random(grid.shape, dtype=np.float32)
    evidence[grid.occupied & (chance < lost)] = 0.0
    evidence[grid.free & (chance < specks)] = -0.8
    row, column = _cells(grid)
    shift = [cv2.resize(rng.normal(0.0, shake, [side // 40 + 2 for side in grid.shape]
                                   ).astype(np.float32), grid.shape[::-1],
                        interpolation=cv2.INTER_CUBIC) for _ in range(2)]
    evidence = cv2.remap(evidence, column + shift[0], row + shift[1], cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def furnished(grid: Grid, rng: Random, count: int) -> Grid:
    """Put boxes of 0.2 to 0.8 m into free space, as furniture that was moved."""
    evidence = grid.evidence.copy()
    wide = np.flatnonzero(cv2.erode(grid.free.astype(np.uint8), np.ones((9, 9), np.uint8)))
    for cell in rng.choice(wide, count if len(wide) else 0):
        row, column = divmod(int(cell), grid.shape[1])
        h, w = (rng.uniform(0.1, 0.4, 2) / grid.resolution).astype(int) + 1
        box = evidence[max(0, row - h):row + h, max(0, column - w):column + w]
        box[:] = 0.0
        box[[0, -1]] = box[:, [0, -1]] = -1.0
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def redrawn(grid: Grid, resolution: float) -> Grid:
    """Draw a map anew with larger cells; a cell with some wall is wall."""
    share = grid.resolution / resolution
    size = tuple(max(8, int(np.ceil(side * share))) for side in grid.shape[::-1])
    walls, free = (cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
                   for mask in (grid.occupied, grid.free))
    evidence = np.where(walls > 0.25 * share, -1.0, free > 0.4).astype(np.float32)
    return Grid(evidence, grid.resolution * grid.shape[1] / size[0], grid.T_frame_grid)


def turned(grid: Grid, rng: Random) -> Grid:
    """Give a map another frame."""
    T = rng.uniform(-9.0, 9.0), rng.uniform(-9.0, 9.0), rng.uniform(-3.1, 3.1)
    return Grid(grid.evidence, grid.resolution, Pose.from_array(compose(T, grid.T_frame_grid)))


def cut(grid: Grid, low: float, high: float) -> Grid:
    """Keep what lies between two distances [m] from the left edge."""
    evidence = grid.evidence.copy()
    evidence[:, :max(0, int(low / grid.resolution))] = 0.0
    evidence[:, max(0, int(high / grid.resolution)):] = 0.0
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def window(grid: Grid, rng: Random, side: float) -> tuple[Grid, Grid]:
    """Cut a window of about `side` [m] around some free place: it, and what lies outside."""
    free = np.argwhere(grid.free)
    spot = free[rng.integers(len(free))] if len(free) else np.zeros(2, int)
    half = (0.5 * side * rng.uniform(0.6, 1.0, 2) / grid.resolution).astype(int)
    (top, left), (bottom, right) = np.maximum(spot - half, 0), spot + half
    inside = np.zeros(grid.shape, bool)
    inside[top:bottom, left:right] = True
    here, there = (Grid(np.where(mask, grid.evidence, np.float32(0.0)), grid.resolution,
                        grid.T_frame_grid) for mask in (inside, ~inside))
    return here, there


def halves(grid: Grid, overlap: float, rng: Random) -> tuple[Grid, Grid]:
    """Cut a map in two that share a strip of `overlap` [m], or have a gap where it is negative."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    row, column = _cells(grid)
    along = (column * np.cos(angle) + row * np.sin(angle)) * grid.resolution
    middle = np.median(along[grid.free])
    parts = along < middle + overlap / 2.0, along > middle - overlap / 2.0
    return tuple(Grid(np.where(part, grid.evidence, 0.0), grid.resolution, grid.T_frame_grid)
                 for part in parts)


def mirrored(grid: Grid) -> Grid:
    """Give another place that looks alike."""
    return Grid(grid.evidence[:, ::-1], grid.resolution, grid.T_frame_grid)


def scaled(grid: Grid, factor: float) -> Grid:
    """Draw a map larger or smaller than it is, as a sensor with a wrong scale does."""
    x, y, theta = grid.T_frame_grid
    return Grid(grid.evidence, grid.resolution * factor, Pose(x * factor, y * factor, theta))


def wobbled(grid: Grid, rng: Random, amplitude: float, length: float) -> Grid:
    """Shake a map smoothly, by about `amplitude` [m] over a `length` [m]."""
    nodes = [int(side * grid.resolution / length) + 3 for side in grid.shape]
    row, column = _cells(grid)
    shift = [cv2.resize(rng.normal(0.0, amplitude / grid.resolution, nodes).astype(np.float32),
                        grid.shape[::-1], interpolation=cv2.INTER_CUBIC) for _ in range(2)]
    evidence = cv2.remap(grid.evidence, column + shift[0], row + shift[1], cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def meshed(grid: Grid, rng: Random) -> Grid:
    """Draw a map as from the mesh of a depth camera: no clutter, thick walls, holes in them."""
    grid = emptied(grid, rng, 1.5)
    thick = int(rng.integers(2, 5))
    walls = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((thick, thick), np.uint8)) > 0
    evidence = np.where(walls & grid.known, np.float32(-1.0), grid.evidence)
    spots = np.argwhere(walls)
    if len(spots) == 0:
        return grid
    for row, column in spots[rng.integers(len(spots), size=len(spots) // 600 + 1)]:
        r = int(rng.uniform(0.1, 0.6) / grid.resolution) + 1
        part = evidence[max(0, row - r):row + r, max(0, column - r):column + r]
        part[part < 0] = 0.0
    return wobbled(Grid(evidence, grid.resolution, grid.T_frame_grid), rng,
                   rng.uniform(0.03, 0.12), rng.uniform(2.0, 5.0))


def drawn_as(grid: Grid, rng: Random, style: int) -> Grid:
    """
    Draw a map as other SLAMs and sensors do.

    0: in greys, as Cartographer; 1: with thick walls and holes, as slam_toolbox with a coarse
    scan; 2: with much noise, of a cheap lidar; 3: with unseen specks in what is free, between the
    beams of few scans, as gmapping.
    """
    if style == 0:
        grey = rng.uniform(0.62, 1.0, grid.shape).astype(np.float32)
        return Grid(grid.evidence * grey, grid.resolution, grid.T_frame_grid)
    if style == 1:
        thick = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        evidence = np.where(thick & grid.known, np.float32(-1.0), grid.evidence)
        return worn(Grid(evidence, grid.resolution, grid.T_frame_grid), rng, 0.5, 0.15, 0.0002)
    if style == 3:
        unseen = rng.random(grid.shape, dtype=np.float32) < rng.uniform(0.03, 0.15)
        evidence = np.where(unseen & grid.free, np.float32(0.0), grid.evidence)
        return worn(Grid(evidence, grid.resolution, grid.T_frame_grid), rng)
    return worn(grid, rng, 1.5, 0.2, 0.003)


def _cells(grid: Grid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return rows (H, 1) and columns (1, W) of a map, which together span its cells."""
    height, width = grid.shape
    return (np.arange(height, dtype=np.float32)[:, None],
            np.arange(width, dtype=np.float32)[None])
