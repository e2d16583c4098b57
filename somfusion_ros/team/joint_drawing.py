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
from somfusion_ros.grid import Grid
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.view_set import ViewSet

Draw = Callable[[Mapping[str, ViewSet], Mapping[str, Array], float], Grid]


class JointDrawing:
    """
    Draws at a resolution [m]; all anew in one part of so many of the time, by a clock [s].

    draw: what draws all anew; say: what is told whose views are left out.
    """

    def __init__(self, resolution: float, share: float, clock: Callable[[], float],
                 draw: Draw = draw_joint, say: Callable[[str], object] = lambda text: None
                 ) -> None:
        self._resolution, self._share, self._clock, self._anew = resolution, share, clock, draw
        self._say, self._far = say, ''
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
        start = self._clock()
        self._whole = start >= self._due
        if self._whole:
            self._map = self._near(robots, poses)
            self._due = start + self._share * (self._clock() - start)
        else:
            try:
                grid = draw_joint(robots, poses, self._resolution, mapper=self._mapper)
                self._map = _shared(grid, poses)
            except ValueError:      # too large for one map
                self._mapper = Mapper(self._resolution)
                self._map = self._near(robots, poses)
        self.drawn = poses
        return self._map

    def _near(self, robots: Mapping[str, ViewSet], poses: Mapping[str, Array]) -> SharedMap:
        """Draw all anew; where that would be too large, without the views that lie far away."""
        try:
            return _shared(self._anew(robots, poses, self._resolution), poses)
        except ValueError as error:
            if len(poses) == 1:
                raise
            middle = np.median(np.concatenate([part[:, :2] for part in poses.values()]), axis=0)
            far = max(sorted(poses), key=lambda name: np.hypot(
                *(poses[name][:, :2] - middle).T).max())
            if far != self._far:
                self._far = far
                self._say(f'the views of {far} are left out of the global map: {error}')
            return self._near(robots, {name: part for name, part in poses.items() if name != far})


def _shared(grid: Grid, poses: Mapping[str, Array]) -> SharedMap:
    """Return a map, and where robots have driven in it."""
    return SharedMap(grid, np.concatenate([part[:, :2] for part in poses.values()]))
