# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global map as it is drawn, whenever one of its maps or poses changed."""

from collections.abc import Callable, Collection, Mapping

import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.shared_map import SharedMap

FEW_CELLS = 4_000_000    # of a global map cost nothing; more must be
MOST_SPREAD = 64         # times what the maps hold at most: fifty in a line, cornerwise, have 50
DIGITS = 4    # of the poses that maps are drawn at [m, rad], so that all robots draw alike


class GlobalDrawing:
    """Draws the maps of a connected team into one; robot_radius [m] is that of their bodies."""

    def __init__(self, robot_radius: float, say: Callable[[str], object]) -> None:
        self._robot_radius, self._say = robot_radius, say
        self._own, self._trusted = '', set[str]()
        self._drawn: dict[str, tuple[SharedMap, Pose]] = {}

    def draw(self, shown: Mapping[str, SharedMap], world: Mapping[str, Pose], own: str,
             trusted: Collection[str]) -> Grid | None:
        """
        Draw maps at T_world_map; None where that would look like the last drawing.

        Where a robot has driven is free only if it is the own one, or trusted: the own match
        accepted it.
        """
        self._own, self._trusted = own, {own, *trusted}
        parts = {robot: (shown[robot], Pose(*np.round(pose, DIGITS)))
                 for robot, pose in world.items() if robot in shown}
        if not parts or self._looks_drawn(parts):
            return None
        self._drawn = parts
        return self._merge(parts)

    def _merge(self, parts: dict[str, tuple[SharedMap, Pose]]) -> Grid:
        """
        Merge maps at their poses; where that would be too large, without the ones far away.

        Maps that lie about fill little of what is drawn: a liar with a small map is not to make
        the others draw a large one.

        The cells are those of the middle map, so that no single peer can make them absurd.
        """
        sizes = sorted(shared.grid.resolution for shared, _ in parts.values())
        most = FEW_CELLS + MOST_SPREAD * sum(
            shared.grid.evidence.size for shared, _ in parts.values())
        try:
            return merge_grids(
                {robot: shared.grid for robot, (shared, _) in parts.items()},
                {robot: pose for robot, (_, pose) in parts.items()}, sizes[(len(sizes) - 1) // 2],
                {robot: shared.driven for robot, (shared, _) in parts.items()
                 if robot in self._trusted},
                self._robot_radius, self._own, most)
        except ValueError as error:
            if len(parts) == 1:
                raise
            middle = np.median([pose[:2] for _, pose in parts.values()], axis=0)
            far = max(parts, key=lambda robot: (
                robot != self._own, np.hypot(*(parts[robot][1][:2] - middle))))
            self._say(f'{far} is left out of the global map: {error}')
            return self._merge({robot: part for robot, part in parts.items() if robot != far})

    def _looks_drawn(self, parts: dict[str, tuple[SharedMap, Pose]]) -> bool:
        """Return whether the same maps lay at the same poses when last drawn."""
        return parts.keys() == self._drawn.keys() and all(
            shared is self._drawn[robot][0] and pose == self._drawn[robot][1]
            for robot, (shared, pose) in parts.items())
