# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a lost robot is in a map: what it saw of late is searched for everywhere in the map.

A search over all places and headings proposes, cells of free space and surface verify. As places
look alike, a pose is believed only if nothing else fits nearly as well, if the surfaces fix it in
every direction, and if a second search finds the same after the robot has driven on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from somfusion_ros.geometry import apply, Array, between, compose, inverse, rotation
from somfusion_ros.grid import Grid
from somfusion_ros.slam.correlative import search
from somfusion_ros.slam.correlative import TUNING as SEARCH
from somfusion_ros.slam.covariance import turned
from somfusion_ros.slam.drawn_map import DrawnMap
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import Match, refine
from somfusion_ros.slam.relocation_tuning import TUNING
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True, eq=False)
class Query:
    """What a robot saw of late: surface in the frame of its newest view, map, that view's pose."""

    cloud: Cloud
    drawn: DrawnMap
    pose: Array

    @classmethod
    def of_views(cls, poses: Array, clouds: Sequence[Cloud], grid: Grid) -> 'Query':
        """Join what the newest views at poses (n, 3) of a map saw."""
        near, drawn = range(max(0, len(poses) - TUNING.views), len(poses)), DrawnMap(grid)
        seen = LocalMap.of_views([clouds[k] for k in near], list(poses[near.start:]))
        kept = _thin(seen.points, TUNING.query)
        kept = kept[drawn.stands(seen.points[kept])]
        noise = float(np.mean([clouds[k].noise for k in near]))
        back = inverse(poses[-1])
        turned = seen.normals[kept] @ rotation(float(back[2])).T
        return cls(Cloud(apply(back, seen.points[kept]), turned, noise=noise,
                         spacing=TUNING.query), drawn, poses[-1])


@dataclass(frozen=True, eq=False)
class Placed:
    """
    A query placed in a map: the match, and how well it fits.

    explained: share of its points on the surface of the map; agreement: share, of what both
    sides saw, that agrees; rival: worth of the best pose elsewhere; off (3,): how far [m, m, rad]
    it is from where another search put it, in its own axes.
    """

    match: Match
    explained: float
    agreement: float
    rival: float = 0.0
    off: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def covariance(self) -> Array:
        """
        Return the 3 x 3 covariance of the pose, in the axes of the map.

        What two searches differ by tells more of the error than the residuals of one.
        """
        off = turned(-self.match.T_map_scan[2]) @ self.off
        total: Array = self.match.covariance + np.outer(off, off)
        return total

    @property
    def worth(self) -> float:
        """Product of both, by which poses are compared."""
        return self.explained * self.agreement

    def refusal(self, left: float = TUNING.left) -> str:
        """Return why the pose is not believed, or ''; left: share that any pose leaves open."""
        t = TUNING
        sigma = np.sqrt(np.linalg.eigvalsh(self.match.covariance[:2, :2])[-1])
        turn = np.sqrt(self.match.covariance[2, 2])
        if self.explained < t.explained:
            return f'the map explains {100 * self.explained:.0f} % of what is seen'
        if self.agreement < t.agreement:
            return f'{100 * self.agreement:.0f} % of what both saw agree'
        if sigma > t.sure[0] or turn > t.sure[1]:
            return f'the surfaces fix the pose to {sigma:.2f} m and {turn:.2f} rad only'
        if 1.0 - self.rival < t.clearer * (1.0 - self.worth) + left:
            return (f'another place fits {100 * self.rival:.0f} %, the best '
                    f'{100 * self.worth:.0f} %')
        return ''


class KnownMap:
    """The surface and the free space of a whole map, in its frame, to be searched."""

    def __init__(self, poses: Array, clouds: Sequence[Cloud], grid: Grid) -> None:
        whole, self._drawn = LocalMap.of_views(clouds, list(poses)), DrawnMap(grid)
        kept = _thin(whole.points, TUNING.thinned)
        kept = kept[self._drawn.stands(whole.points[kept])]
        self._surface = LocalMap(whole.points[kept], whole.normals[kept])
        self._centres = _tiles(poses)

    def find(self, query: Query) -> Placed | None:
        """Return the best pose of a query; None where the map or the query shows nothing."""
        if min(len(query.cloud), len(self._surface)) < TUNING.views_least:
            return None
        best = self._place(query, None, TUNING.least)
        if best is None:
            return None
        other = self._place(query, best.match.T_map_scan, TUNING.least_rival)
        if other is None:
            return best
        if other.worth > best.worth:
            best, other = other, best
        return Placed(best.match, best.explained, best.agreement, other.worth)

    def place(self, query: Query, pose: Array) -> Placed:
        """Refine a query's pose (3,), and judge it."""
        match = refine(query.cloud, self._surface, pose)
        explained, agreement = self._judge(query, match.T_map_scan)
        return Placed(match, explained, agreement)

    def _place(self, query: Query, taken: Array | None, least: float) -> Placed | None:
        """Search everywhere but at a pose (3,) that is taken; None where nothing scores enough."""
        elsewhere = None if taken is None else partial(_apart, taken=taken)
        peak = search(query.cloud, self._surface, self._centres, TUNING.tile, np.pi, elsewhere,
                      with_rival=False, least=least)
        return self.place(query, peak.pose) if peak.score > 0.0 else None

    def _judge(self, query: Query, pose: Array) -> tuple[float, float]:
        """
        Return which share of a query at a pose (3,) is explained, and which agrees.

        Against the pose are its points in free space of the map, and the map's points in free
        space of the query; what one side never saw says nothing.
        """
        t = TUNING
        points = apply(pose, query.cloud.points)
        distance, _ = self._surface.tree.query(points, distance_upper_bound=t.off_surface)
        on = t.query * np.count_nonzero(distance < t.on_surface)
        off = points[~np.isfinite(distance)]
        against = t.query * np.count_nonzero(self._drawn.free(off))
        mine = apply(inverse(pose), self._surface.points)
        mine = mine[query.drawn.free(apply(query.pose, mine))]
        if len(mine):
            tree = cKDTree(query.cloud.points)
            far, _ = tree.query(mine, distance_upper_bound=t.off_surface)
            against += t.thinned * np.count_nonzero(~np.isfinite(far))
        explained = on / (t.query * len(points))
        return float(explained), float(on / max(on + against, 1e-9))


class Relocation:
    """Looks for a lost robot until it is found; astray: whether it had a place, and drove on."""

    def __init__(self, known: KnownMap, astray: bool = False) -> None:
        self._known, self._left = known, TUNING.left_astray if astray else TUNING.left
        self._last: Array | None = None    # T_map_piece (3,) of the last search that was clear
        self.refusal = 'it has not seen enough yet'

    def still_here(self, poses: Array, clouds: Sequence[Cloud], grid: Grid,
                   hints: Sequence[Array]) -> Placed | None:
        """
        Return the place of the newest view where it is about as good as any, at one of the hints.

        hints: poses (3,) in the map where the robot is likely, as it stood there before. The
        whole map is searched all the same: a robot may have been carried.
        """
        query = Query.of_views(poses, clouds, grid)
        if len(query.cloud) < TUNING.views_least:
            return None
        best = max((self._known.place(query, hint) for hint in hints), key=lambda p: p.worth)
        anywhere = self._known.find(query)
        likely = (best.explained >= TUNING.stands[0] and best.agreement >= TUNING.stands[1]
                  and any(_same(best.match.T_map_scan, hint, np.zeros(3)) for hint in hints))
        rival = anywhere.worth if anywhere else 0.0
        return best if likely and best.worth >= rival - TUNING.prior else None

    def look(self, poses: Array, clouds: Sequence[Cloud], grid: Grid) -> Placed | None:
        """
        Search for the newest of the views at poses (n, 3) of a piece of map; None until found.

        The match places the newest view.
        """
        if len(poses) < TUNING.views_least:
            return None
        placed = self._known.find(Query.of_views(poses, clouds, grid))
        self.refusal = 'there is too little surface' if placed is None else (
            placed.refusal(self._left))
        if placed is None or self.refusal:
            return None
        T_map_piece = compose(placed.match.T_map_scan, inverse(poses[-1]))
        before, self._last = self._last, T_map_piece
        if before is None or not _same(T_map_piece, before, poses[-1]):
            self.refusal = 'it drives on to be sure'
            return None
        return replace(placed, off=between(compose(before, poses[-1]), placed.match.T_map_scan))


def _same(one: Array, other: Array, pose: Array) -> bool:
    """Return whether two poses (3,) of a piece put a pose (3,) in it at the same place."""
    d = between(compose(one, pose), compose(other, pose))
    return bool(np.hypot(d[0], d[1]) < TUNING.same[0] and abs(d[2]) < TUNING.same[1])


def _apart(poses: Array, taken: Array) -> NDArray[np.bool_]:
    """Return the mask (n,) of the poses (n, 3) that are clearly others than one (3,)."""
    d = between(taken, poses)
    away, turned = SEARCH.distinct
    apart: NDArray[np.bool_] = (np.hypot(d[:, 0], d[:, 1]) > away) | (np.abs(d[:, 2]) > turned)
    return apart


def _tiles(poses: Array) -> Array:
    """Return middles (m, 3) of search windows that have views at poses (n, 3) near."""
    edge = 2.0 * TUNING.tile
    corners = [np.floor((poses[:, :2] + shift) / edge) for shift in
               TUNING.margin * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1), (0, 0)])]
    tiles = np.unique(np.concatenate(corners), axis=0)
    return np.column_stack([(tiles + 0.5) * edge, np.zeros(len(tiles))])


def _thin(points: Array, edge: float) -> NDArray[np.intp]:
    """Return the indices of one of the points (n, 2) in every square of an edge [m]."""
    squares = np.floor(points / edge).astype(np.int64) @ (1 << 24, 1)
    _, first = np.unique(squares, return_index=True)
    return np.sort(first)
