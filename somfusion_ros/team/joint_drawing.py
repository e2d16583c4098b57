# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The elastic map of a live team as it grows: what is new at once, the whole at leisure.

What a peer tells late was seen earlier than what is drawn already. It is drawn on top until there
is time to draw all anew in the order of time, which all robots then have alike, to the bit.
"""

from collections.abc import Callable, Mapping

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid, MAX_CELLS
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.view_set import ViewSet

Draw = Callable[[Mapping[str, ViewSet], Mapping[str, Array], float], Grid]


class JointDrawing:
    """
    Draws at a resolution [m]; all anew in one part of so many of the time, by a clock [s].

    draw: what draws all anew; say: what is told whose views are left out, never those of the own
    robot.
    """

    def __init__(self, resolution: float, share: float, clock: Callable[[], float],
                 draw: Draw = draw_joint, say: Callable[[str], object] = lambda text: None,
                 own: str = '') -> None:
        self._resolution, self._share, self._clock, self._anew = resolution, share, clock, draw
        self._say, self._far, self._own = say, '', own
        self._mapper = Mapper(resolution)
        self._map: SharedMap | None = None
        self._due = -np.inf
        self._whole = False
        self.drawn: Mapping[str, Array] | None = None

    def draw(self, robots: Mapping[str, ViewSet], poses: Mapping[str, Array]) -> SharedMap:
        """Draw views where they lie now (n, 3); the same map as long as nothing is to be done."""
        if self._map is not None and self.drawn is poses and (
                self._whole or self._clock() < self._due):
            return self._map
        start, near = self._clock(), self._near(poses)
        self._whole = start >= self._due
        if self._whole:
            grid = self._anew(robots, near, self._resolution)
            self._due = start + self._share * (self._clock() - start)
        else:
            grid = draw_joint(robots, near, self._resolution, mapper=self._mapper)
        self._map, self.drawn = _shared(grid, near), poses
        return self._map

    def _near(self, poses: Mapping[str, Array]) -> Mapping[str, Array]:
        """Leave out who lies so far away that the map would be too large, before it is made."""
        near, far = dict(poses), ''
        while len(near) > 1 and _cells(near, self._resolution) > MAX_CELLS:
            middle = np.median(np.concatenate([part[:, :2] for part in near.values()]), axis=0)
            far = max(sorted(near), key=lambda name: (name != self._own, np.hypot(
                *(near[name][:, :2] - middle).T).max()))
            del near[far]
        if far != self._far and far:
            self._say(f'the views of {far} are left out of the global map: too far away')
        self._far = far
        return near


def _cells(poses: Mapping[str, Array], resolution: float) -> float:
    """Return how many cells a map has that holds views at poses (n, 3) by robot."""
    places = np.concatenate([part[:, :2] for part in poses.values()])
    return float(np.prod(np.ptp(places, axis=0) / resolution + 1.0))


def _shared(grid: Grid, poses: Mapping[str, Array]) -> SharedMap:
    """Return a map, and where robots have driven in it."""
    return SharedMap(grid, np.concatenate([part[:, :2] for part in poses.values()]))
