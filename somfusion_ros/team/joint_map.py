# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team's map, drawn from all robots' views where the joint solution has them.

Evidence is summed in the order of time, whoever saw it, so that what was taken away since is
cleared. A scan between two views lies between where both have it.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.team.view_set import ViewSet


@dataclass(frozen=True, eq=False)
class Held:
    """Views (m,) on which a robot hung, one after another, and the stamps (m,) [s] since when."""

    since: Array
    views: NDArray[np.intp]

    @classmethod
    def of(cls, trail: Array) -> 'Held':
        """Find them in a trail (m, 5): stamp, view, and pose in the view."""
        views = trail[:, 1].astype(np.intp)
        first = np.flatnonzero(np.diff(views, prepend=-1))
        return cls(trail[first, 0], views[first])


class JointMap:
    """Draws views; only new ones while old ones stand still, all anew once they moved."""

    def __init__(self, resolution: float) -> None:
        self._mapper = Mapper(resolution)

    def render(self, robots: Mapping[str, ViewSet], poses: Mapping[str, Array],
               only: Collection[str] | None = None) -> Grid:
        """
        Draw the views of all robots, or of some, at their poses (n, 3) by robot.

        A robot's views beyond its poses are not drawn.
        """
        names = sorted(robots.keys() & poses.keys() if only is None else only)
        drawn = [_placed(robots[name], poses[name]) for name in names]
        order = sorted((stamp, rank, k) for rank, (stamps, _, _) in enumerate(drawn)
                       for k, stamp in enumerate(stamps))
        scans = [MapScan(index, np.zeros(3), drawn[rank][2][k])
                 for index, (_, rank, k) in enumerate(order)]
        return self._mapper.render(
            scans, np.array([drawn[rank][1][k] for _, rank, k in order]).reshape(-1, 3))


def _placed(views: ViewSet, poses: Array) -> tuple[list[float], list[Array], list[Outline]]:
    """Stamps of views and of scans between them, their poses (3,) in the world, what they saw."""
    stamps, placed = views.stamps[:len(poses)].tolist(), list(poses)
    seen = [cloud.outline for cloud in views.clouds[:len(poses)]]
    for scan in views.between:
        if scan.view + 1 < len(poses) and views.steps[scan.view].first == scan.view:
            hung, step = scan.T_view_base, views.steps[scan.view].z
            near = compose(poses[scan.view], hung)
            far = compose(poses[scan.view + 1], between(step, hung))
            share = min(1.0, float(np.abs(hung).sum() / max(np.abs(step).sum(), 1e-6)))
            placed.append(compose(near, share * between(near, far)))
            stamps.append(views.stamps[scan.view] + share * (
                views.stamps[scan.view + 1] - views.stamps[scan.view]))
            seen.append(scan.outline)
        elif scan.view < len(poses):
            placed.append(compose(poses[scan.view], scan.T_view_base))
            stamps.append(views.stamps[scan.view])
            seen.append(scan.outline)
    return stamps, placed, seen


def draw_joint(robots: Mapping[str, ViewSet], poses: Mapping[str, Array], resolution: float,
               only: Collection[str] | None = None) -> Grid:
    """Draw the views of all robots, or of some, once."""
    return JointMap(resolution).render(robots, poses, only)


def along(stamps: Array, path: Array, held: Held, own: Array, poses: Array) -> Array:
    """
    Take a path (m, 3) at stamps (m,) from a robot's own map into the world.

    held: on which views the robot hung, and since when; own and poses (n, 3): where the views lie
    in the own map and in the world. From one view to the next the path goes over smoothly.
    """
    a = np.clip(np.searchsorted(held.since, stamps, side='right') - 1, 0, len(held.since) - 1)
    b = np.minimum(a + 1, len(held.since) - 1)
    span = held.since[b] - held.since[a]
    share = np.clip((stamps - held.since[a]) / np.where(span > 0.0, span, np.inf), 0.0, 1.0)
    near, far = (compose(poses[held.views[k]], between(own[held.views[k]], path)) for k in (a, b))
    return compose(near, share[:, None] * between(near, far))
