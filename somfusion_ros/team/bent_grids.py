# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Saved maps, bent until they fit: for robots whose views nobody has.

Each map is laid onto those before it by the smooth warp with which verdicts judge how far two maps
are bent (`fusion.deformation`), and drawn along it. Where the walls do not agree better then, it
is drawn as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.deformation import bend
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import apply, Array, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.wall_agreement import wall_agreement


@dataclass(frozen=True)
class BentGridSettings:
    """When and how a map is bent."""

    better: float = tuned(0.01, '', 'share of walls that must agree more, for a map to be bent',
                          'shared teams')
    margin: float = tuned(1.0, 'm', 'around a map, into which it may bend', 'as the warp reaches')
    rounds: int = tuned(3, 'rounds', 'in which the warp is found, each from the last',
                        'shared teams')


SETTINGS = BentGridSettings()
TOGETHER = 1 << 20     # cells that are drawn at a time, so that a large map takes little memory


@dataclass(frozen=True, eq=False)
class BentMaps:
    """Every map in the world, all of them summed, and how far [m] each was bent at most."""

    maps: dict[str, Grid]
    whole: Grid
    bends: dict[str, float]


def merge_bent(grids: Mapping[str, Grid], world: Mapping[str, Pose],
               config: FusionConfig | None = None) -> BentMaps:
    """
    Draw maps in the world, each bent onto those before it.

    Parameters
    ----------
    grids : map by robot
    world : T_world_map of those that are drawn; the first of them stays as it is
    config : of the fusion
    """
    first, *others = world
    whole = merge_grids({first: grids[first]}, {first: world[first]})
    maps, bends = {first: whole}, {first: 0.0}
    for name in others:
        rigid = merge_grids({name: grids[name]}, {name: world[name]})
        maps[name], bends[name] = _onto(whole, rigid, config)
        whole = merge_grids({'': whole, name: maps[name]}, {'': Pose(), name: Pose()})
    return BentMaps(maps, whole, bends)


def _onto(target: Grid, source: Grid, config: FusionConfig | None) -> tuple[Grid, float]:
    """Bend a map onto another in the same frame; return it and how far [m] it was bent."""
    cache, agreed = FusionCache(), wall_agreement(target, source)
    learned, best, moved = learn(target, config, cache), source, 0.0
    for _ in range(SETTINGS.rounds):
        placed = learn(best, config, cache)
        if not (len(learned.features) and len(placed.features)):
            break
        warp = bend(np.zeros(3), learned, placed).warp
        bent = warped(best, warp)
        agrees = wall_agreement(target, bent)
        if not agrees > agreed + SETTINGS.better:
            break
        best, agreed = bent, agrees
        moved += float(np.hypot(*np.moveaxis(warp.displacements, -1, 0)).max())
    return best, moved


def warped(grid: Grid, warp: Warp) -> Grid:
    """Draw a map along a warp of its frame."""
    margin = int(np.ceil(SETTINGS.margin / grid.resolution))
    height, width = (side + 2 * margin for side in grid.shape)
    low = apply(grid.T_frame_grid, np.full((1, 2), -margin * grid.resolution))[0]
    corner = Pose(float(low[0]), float(low[1]), grid.T_frame_grid.theta)
    evidence, together = np.zeros((height, width), np.float32), max(TOGETHER // width, 1)
    columns, rows = (np.arange(side, dtype=np.float32) for side in (width, height))
    for first in range(0, height, together):
        band = slice(first, first + together)
        centres = np.stack(np.meshgrid(columns, rows[band]), axis=-1).reshape(-1, 2) + 0.5
        came = _came(warp, apply(corner, centres * grid.resolution))
        evidence[band] = _nearest(grid, came).reshape(-1, width)
    return Grid(evidence, grid.resolution, corner)


def _came(warp: Warp, points: Array) -> Array:
    """Return from where a warp takes points (N, 2) [m]: it is given where it leads from."""
    wanted = points.T.astype(np.float32)
    came: Array = wanted
    for _ in range(4):
        came = wanted - warp.at(came)
    return came.T


def _nearest(grid: Grid, points: Array) -> Array:
    """Return the evidence (N,) at points (N, 2) [m] of a map's frame, 0 outside the map."""
    local = apply(inverse(grid.T_frame_grid), points) / grid.resolution - 0.5
    column, row = np.rint(local.T.astype(np.float32)).astype(np.intp)
    height, width = grid.shape
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    return np.where(inside, grid.evidence.ravel()[np.where(inside, row * width + column, 0)], 0.0)
