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


def draw_joint(robots: Mapping[str, ViewSet], poses: Mapping[str, Array], resolution: float,
               only: Collection[str] | None = None, mapper: Mapper | None = None) -> Grid:
    """
    Draw the views of all robots, or of some, at their poses (n, 3) by robot.

    A robot's views beyond its poses are not drawn. All is drawn anew, so that the map depends on
    nothing but what is drawn: 0.3 ms a scan. A mapper of before draws what is new, or all where
    something moved.
    """
    names = sorted(robots.keys() & poses.keys() if only is None else only)
    drawn = [scan for name in names for scan in _placed(robots[name], poses[name])]
    drawn.sort(key=lambda scan: scan[0])
    scans = [MapScan(k, np.zeros(3), outline) for k, (_, _, outline) in enumerate(drawn)]
    placed = np.array([pose for _, pose, _ in drawn]).reshape(-1, 3)
    return (mapper or Mapper(resolution)).render(scans, placed)


def _placed(views: ViewSet, poses: Array) -> list[tuple[float, Array, Outline]]:
    """Return stamps, poses (3,) in the world and outlines of views and scans between them."""
    n = len(poses)
    placed = [(float(stamp), pose, cloud.outline)
              for stamp, pose, cloud in zip(views.stamps[:n], poses, views.clouds[:n])
              if len(cloud.outline.reach)]     # else it was taken back
    for scan in views.between:
        if scan.view >= n:
            continue
        pose, hung = compose(poses[scan.view], scan.T_view_base), scan.T_view_base
        after = scan.view + 1
        if (after < n and views.steps[scan.view].first == scan.view
                and scan.stamp <= views.stamps[after]):
            step = views.steps[scan.view].z
            share = min(1.0, float(np.abs(hung).sum() / max(np.abs(step).sum(), 1e-6)))
            far = compose(poses[after], between(step, hung))
            pose = compose(pose, share * between(pose, far))
        placed.append((scan.stamp, pose, scan.outline))
    return placed


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
