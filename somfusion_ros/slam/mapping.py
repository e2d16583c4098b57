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


class Mapper:
    """
    Renders scans: new ones, and where poses moved, what the moved ones see now and saw before.

    A scan that is not kept any more stays drawn until then, under what is drawn over it. One with
    which the map would be too large is left out, and counted in counters as `map_scans_too_far`.
    """

    def __init__(self, resolution: float, counters: Counter[str] | None = None) -> None:
        self.resolution = resolution
        self._counters: Counter[str] = Counter() if counters is None else counters
        self._clear()

    def _clear(self) -> None:
        self._cells = np.zeros((0, 0), np.float32)
        self._corner = np.zeros(2, np.intp)      # column, row of cell (0, 0) on the map's lattice
        self._rendered: dict[Outline, Array] = {}   # pose (3,) at which each was drawn
        self._left_out: set[Outline] = set()        # of these, scans that do not fit

    def render(self, scans: Sequence[MapScan], views: Array) -> Grid:
        """Draw scans, by age, at their views' poses (n, 3); return the map in the map frame."""
        poses = dict(zip([scan.outline for scan in scans], place(scans, views), strict=True))
        moved = self._moved(poses)
        if 2 * len(moved) > len(self._rendered):
            self._clear()
            moved = set()
        self._rendered = {seen: at for seen, at in self._rendered.items() if seen in poses}
        new = [outline for outline in poses if outline not in self._rendered]
        rims = {seen: apply(poses[seen], seen.rim) for seen in (*new, *moved)}
        before, self._left_out = self._left_out, self._unfit(rims)
        if moved:
            self._redraw([(seen, self._rendered[seen]) for seen in moved - before],
                         {seen: poses[seen] for seen in moved - self._left_out})
        for seen in new:
            if seen not in self._left_out:
                self._draw(seen, poses[seen], rims[seen])
        self._rendered = {seen: pose if seen in moved else self._rendered.get(seen, pose)
                          for seen, pose in poses.items()}
        return self.grid()

    def grid(self) -> Grid:
        """Return the map as last rendered; one unknown cell before anything was."""
        if not self._cells.size:
            return Grid(np.zeros((1, 1), np.float32), self.resolution)
        x, y = self._corner * self.resolution
        return Grid(self._cells.copy(), self.resolution, Pose(x, y, 0.0))

    def _moved(self, poses: dict[Outline, Array]) -> set[Outline]:
        """
        Return the drawn scans that lie half a cell or a degree from where they were drawn.

        All of them, where most of what was drawn is another map's.
        """
        both = [seen for seen in self._rendered if seen in poses]
        if 2 * len(both) < len(self._rendered):
            return set(self._rendered)
        d = np.array([poses[seen] - self._rendered[seen] for seen in both]).reshape(-1, 3)
        moved = ((np.abs(d[:, :2]) > 0.5 * self.resolution).any(1)
                 | (np.abs(wrap(d[:, 2])) > 0.01))
        return {both[k] for k in np.flatnonzero(moved)}

    def _unfit(self, rims: dict[Outline, Array]) -> set[Outline]:
        """Make room for scans by their rims; return all with which the map would be too large."""
        left_out = self._left_out - rims.keys()
        if rims:
            fits = self._grow(np.array([_bounds(rim) for rim in rims.values()]))
            left_out |= {seen for seen, fit in zip(rims, fits.tolist(), strict=True) if not fit}
        if left_out:
            self._counters['map_scans_too_far'] = len(left_out)
        return left_out

    def _redraw(self, before: Sequence[tuple[Outline, Array]], now: dict[Outline, Array]) -> None:
        """Draw anew the rectangles that moved scans covered before, and cover now."""
        dirty = np.zeros(self._cells.shape, bool)
        for seen, pose in (*before, *now.items()):
            dirty[self._window(apply(pose, seen.rim))] = True
        self._cells[dirty] = 0.0
        for seen, drawn_at in self._rendered.items():
            if seen not in self._left_out:
                pose = now.get(seen, drawn_at)
                self._draw(seen, pose, apply(pose, seen.rim), dirty)

    def _window(self, rim: Array) -> tuple[slice, slice]:
        """Return rows and columns of the cells around a rim (M, 2) in the map [m]."""
        corner = self._corner * self.resolution
        x0, y0 = np.floor((rim.min(0) - corner) / self.resolution).astype(int)
        x1, y1 = np.ceil((rim.max(0) - corner) / self.resolution).astype(int) + 1
        return slice(y0, y1), slice(x0, x1)

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

    def _draw(self, seen: Outline, pose: Array, rim: Array,
              where: NDArray[np.bool_] | None = None) -> None:
        """Add the evidence of a scan at a pose (3,), with its rim (M, 2) there; where: cells."""
        window = self._window(rim)
        mask = None if where is None else where[window]
        if mask is not None and not mask.any():
            return
        before = self._cells[window]
        after = before if mask is None else before.copy()
        self._add(after, (window[1].start, window[0].start), rim,
                  apply(pose, seen.hits), apply(pose, seen.walls))
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
    fits, floor, ceiling = np.zeros(len(low), bool), low[0], high[0]
    for k in range(len(low)):
        lower, upper = np.minimum(floor, low[k]), np.maximum(ceiling, high[k])
        if np.prod(upper - lower) <= MOST_CELLS:
            fits[k], floor, ceiling = True, lower, upper
    return fits


def _bounds(points: Array) -> Array:
    return np.concatenate([points.min(0), points.max(0)])


def _cells_of(points: Array, corner: Array, resolution: float) -> NDArray[np.intp]:
    """Return the cells (N, 2) as row, column that hold points (N, 2)."""
    cells: NDArray[np.intp] = np.floor((points - corner) / resolution).astype(np.intp)
    return cells[:, ::-1]
