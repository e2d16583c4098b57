# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Mapping: evidence per cell from the scans, at the poses that the filter holds now.

A cell goes down by a step when a beam ends in it and up by a step when a beam passes, clipped
to [-1, 1] (section II-B). A beam that passes within a cell of a surface which the same scan saw
says nothing there: along a corridor it would wipe out the wall that it grazes.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, compose, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.dirty_cells import DirtyCells
from somfusion_ros.slam.drawn_scans import DrawnScans
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import MapScan


@dataclass(frozen=True)
class MappingTuning:
    """Steps of evidence (section II-B)."""

    hit: float = tuned(
        0.4, 'evidence', 'a beam that ends in a cell takes this away',
        'benchmarks/data/real_maps.py')
    passed: float = tuned(
        0.15, 'evidence', 'a beam that passes a cell adds this', 'benchmarks/data/real_maps.py')
    beside: int = tuned(
        3, 'cells', 'across a surface, of which passing beams say nothing',
        'benchmarks/data/real_maps.py')


TUNING = MappingTuning()
SUB = 4       # binary digits of a cell in the polygon fill
MOST_CELLS = 8192 * 8192   # of a robot's own map; fusion_node takes no larger one
MARGIN = 64   # cells added when the map grows
TURN = 0.01   # [rad] by which a scan may lie turned from where it is drawn


class Mapper:
    """
    Renders scans: new ones, and where poses moved, what the moved ones see now and saw before.

    How much is drawn at once may be bounded, whatever the size of the map. A scan that is not
    kept any more stays drawn until then, under what is drawn over it. One with which the map
    would be too large is left out, and counted in counters as `map_scans_too_far`.
    """

    def __init__(self, resolution: float, counters: Counter[str] | None = None) -> None:
        self.resolution = resolution
        self._counters: Counter[str] = Counter() if counters is None else counters
        self._clear()

    def _clear(self) -> None:
        self._cells = np.zeros((0, 0), np.float32)
        self._corner = np.zeros(2, np.intp)      # column, row of cell (0, 0) on the map's lattice
        self._rows: dict[Outline, int] = {}      # of the scans that were drawn, in these:
        self._drawn = DrawnScans.of(0)

    def render(self, scans: Sequence[MapScan], views: Array, most: int | None = None) -> Grid:
        """
        Draw scans, by age, at their views' poses (n, 3); return the map in the map frame.

        most: how many new scans are drawn at once, and how many moved ones are drawn anew, around
        the one that moved farthest; how many are left for later is in counters as
        `map_scans_undrawn` and `map_scans_behind`.
        """
        placed = dict(zip([scan.outline for scan in scans], place(scans, views), strict=True))
        placed = self._up_to(placed, most)
        outlines, poses = list(placed), np.array(list(placed.values())).reshape(-1, 3)
        now = self._drawn.chosen([self._rows.get(seen, -1) for seen in outlines])
        moved = self._moved(now, poses, most)
        if 2 * np.count_nonzero(moved) > len(self._rows) or (
                2 * np.count_nonzero(now.old) < len(self._rows)):   # or it is another map
            self._clear()
            now, moved = DrawnScans.of(len(outlines)), np.zeros(len(outlines), bool)
        before = now.bounds[moved & ~now.left_out]
        again = moved | ~now.old
        now.poses[again] = poses[again]
        for k in np.flatnonzero(again):
            now.bounds[k] = _bounds(outlines[k], poses[k])
        self._fit(now, again)
        shown = now.old & ~now.left_out
        changed = np.vstack([before, now.bounds[moved & shown]])
        if len(changed):
            self._redraw(changed, outlines, now, shown)
        for k in np.flatnonzero(~now.old & ~now.left_out):
            self._draw(outlines[k], now.poses[k], now.bounds[k])
        now.old[:] = True
        self._rows, self._drawn = {seen: k for k, seen in enumerate(outlines)}, now
        return self.grid()

    def grid(self) -> Grid:
        """Return the map as last rendered; one unknown cell before anything was."""
        if not self._cells.size:
            return Grid(np.zeros((1, 1), np.float32), self.resolution)
        x, y = self._corner * self.resolution
        return Grid(self._cells.copy(), self.resolution, Pose(x, y, 0.0))

    def _up_to(self, placed: dict[Outline, Array], most: int | None) -> dict[Outline, Array]:
        """Leave out the new scans beyond the oldest `most`."""
        new = [seen for seen in placed if seen not in self._rows]
        later = set() if most is None else set(new[most:])
        self._counters['map_scans_undrawn'] = len(later)
        return {seen: pose for seen, pose in placed.items() if seen not in later}

    def _moved(self, now: DrawnScans, poses: Array, most: int | None) -> NDArray[np.bool_]:
        """Tell which of the drawn scans lie half a cell or a degree from where they are drawn."""
        d = np.abs(poses - now.poses)
        d[:, 2] = np.abs(wrap(d[:, 2])) * (0.5 * self.resolution / TURN)
        off = d.max(1, initial=0.0) * now.old
        moved: NDArray[np.bool_] = off > 0.5 * self.resolution
        if most is not None:
            behind = max(0, int(np.count_nonzero(moved)) - most)
            self._counters['map_scans_behind'] = behind
            if behind:
                away = np.hypot(*(now.poses[:, :2] - now.poses[off.argmax(), :2]).T)
                away[~moved] = np.inf
                moved[np.argsort(away)[most:]] = False
        return moved

    def _fit(self, now: DrawnScans, again: NDArray[np.bool_]) -> None:
        """Make room for some of the scans; mark those with which the map would be too large."""
        if again.any():
            now.left_out[again] = ~self._grow(now.bounds[again])
        self._counters['map_scans_too_far'] = int(np.count_nonzero(now.left_out))

    def _redraw(self, changed: Array, outlines: Sequence[Outline], now: DrawnScans,
                shown: NDArray[np.bool_]) -> None:
        """Draw anew the rectangles (n, 4) [m] that moved scans covered before, and cover now."""
        dirty = DirtyCells.of(self._windows(changed))
        self._cells[dirty.window][dirty.mask] = 0.0
        touched = dirty.touch(self._windows(now.bounds[shown]))
        for k in np.flatnonzero(shown)[touched]:
            self._draw(outlines[k], now.poses[k], now.bounds[k], dirty)

    def _windows(self, bounds: Array) -> NDArray[np.intp]:
        """Return the cells (n, 4), columns x0 to x1, rows y0 to y1, around bounds (n, 4) [m]."""
        cells = bounds / self.resolution - np.tile(self._corner, 2)
        windows: NDArray[np.intp] = np.concatenate(
            [np.floor(cells[:, :2]) - 1, np.ceil(cells[:, 2:]) + 2], axis=1).astype(np.intp)
        return windows

    def _grow(self, bounds: Array) -> NDArray[np.bool_]:
        """
        Make room for rectangles (n, 4) x0, y0, x1, y1 [m]; the lattice stays where it is.

        Returns which of them fit: in the order given, as long as the map is not too large.
        """
        low = np.floor(bounds[:, :2] / self.resolution) - 2
        high = np.ceil(bounds[:, 2:] / self.resolution) + 3
        if self._cells.size:
            old_high = self._corner + self._cells.shape[::-1]
            if (low >= self._corner).all() and (high <= old_high).all():
                return np.ones(len(bounds), bool)
            low = np.vstack([self._corner, np.where(low < self._corner, low - MARGIN, low)])
            high = np.vstack([old_high, np.where(high > old_high, high + MARGIN, high)])
        fits = _together(low, high)
        if not fits.any():
            return fits
        low, high = (corner.astype(np.intp) for corner in (low[fits].min(0), high[fits].max(0)))
        cells = np.zeros((high - low)[::-1], np.float32)
        if self._cells.size:
            (column, row), (h, w) = self._corner - low, self._cells.shape
            cells[row:row + h, column:column + w] = self._cells
        self._cells, self._corner = cells, low
        return fits[-len(bounds):]

    def _draw(self, seen: Outline, pose: Array, bounds: Array,
              where: DirtyCells | None = None) -> None:
        """Add the evidence of a scan at a pose (3,), within its bounds (4,); where: cells."""
        window = self._windows(bounds[None])[0]
        x0, y0, x1, y1 = window.tolist()
        mask = None if where is None else where.within(window)
        before = self._cells[y0:y1, x0:x1]
        after = before if mask is None else before.copy()
        hits, walls = seen.surface()
        self._add(after, (x0, y0), apply(pose, seen.rim),
                  apply(pose, hits), apply(pose, walls))
        if mask is not None:
            before[mask] = after[mask]

    def _add(self, window: Array, first: tuple[int, int], rim: Array, hits: Array,
             walls: Array) -> None:
        """
        Add one scan's evidence to a window (H, W) of the map.

        first: its first column and row; rim (M, 2), hits (N, 2), walls (2 L, 2) in the map [m].
        """
        x0, y0 = first
        corner = self._corner * self.resolution

        def vertices(points: Array) -> NDArray[np.int32]:
            cells = (points - corner) / self.resolution - 0.5 - (x0, y0)
            whole: NDArray[np.int32] = np.rint(cells * (1 << SUB)).astype(np.int32)
            return whole

        passed = np.zeros(window.shape, np.float32)
        cv2.fillPoly(passed, [vertices(rim)], TUNING.passed, shift=SUB)
        cv2.polylines(passed, list(vertices(walls).reshape(-1, 2, 2)), False, 0, TUNING.beside,
                      shift=SUB)
        ends = _cells_of(hits, corner, self.resolution) - (y0, x0)
        passed[ends[:, 0], ends[:, 1]] = 0
        window += passed
        np.minimum(window, 1.0, out=window)
        flat = np.unique(ends[:, 0] * window.shape[1] + ends[:, 1])
        rows, columns = np.divmod(flat, window.shape[1])
        window[rows, columns] = np.maximum(window[rows, columns] - TUNING.hit, -1.0)


def place(scans: Sequence[MapScan], views: Array) -> Array:
    """Return the poses T_map_base (n, 3) of scans that hang on views (m, 3)."""
    if not scans:
        return np.zeros((0, 3))
    return compose(views[[s.view for s in scans]], np.array([s.T_view_base for s in scans]))


def _together(low: Array, high: Array) -> NDArray[np.bool_]:
    """Return which rectangles (n,) of cells fit into one map with those before them."""
    fits, floor, ceiling = np.zeros(len(low), bool), np.full(2, np.inf), np.full(2, -np.inf)
    for k in range(len(low)):
        lower, upper = np.minimum(floor, low[k]), np.maximum(ceiling, high[k])
        if np.prod(upper - lower) <= MOST_CELLS:
            fits[k], floor, ceiling = True, lower, upper
    return fits


def _bounds(seen: Outline, pose: Array) -> Array:
    """Return the rectangle (4,) x0, y0, x1, y1 [m] of what a scan saw at a pose (3,)."""
    points = apply(pose, np.vstack([seen.origin, seen.ends]))
    return np.concatenate([points.min(0), points.max(0)])


def _cells_of(points: Array, corner: Array, resolution: float) -> NDArray[np.intp]:
    """Return the cells (N, 2) as row, column that hold points (N, 2)."""
    cells: NDArray[np.intp] = np.floor((points - corner) / resolution).astype(np.intp)
    return cells[:, ::-1]
