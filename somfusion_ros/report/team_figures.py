# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figure of the whole team: the global map in one colour per robot, and all trajectories."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from matplotlib.axes import Axes
from somfusion_ros.geometry import apply, Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.report.map_figures import legend, show
from somfusion_ros.report.palette import BOTH, team_colours
from somfusion_ros.report.pictures import overlay_picture, Picture


@dataclass(frozen=True, eq=False)
class TeamData:
    """
    What the figure of a team shows, by robot.

    Every map, T_world_map of the connected ones, and the trajectories (N, 3) in their own maps.
    """

    grids: Mapping[str, Grid]
    world: Mapping[str, Pose]
    paths: Mapping[str, Array]

    def draw(self, axes: Axes) -> None:
        """Draw every connected robot's walls and trajectory in the world frame."""
        colours = team_colours(list(self.grids))
        show(axes, self._picture, 'Global map of ' + ', '.join(self.world))
        for name, pose in self.world.items():
            if len(self.paths.get(name, ())):
                points = apply(pose, self.paths[name][:, :2])
                axes.plot(points[:, 0], points[:, 1], color=colours[name], linewidth=1.0,
                          alpha=0.8)
                axes.plot(*points[0], 'o', color=colours[name], markersize=5)
        several = [('several', BOTH)] if len(self.world) > 1 else []
        legend(axes, [(name, colours[name]) for name in self.world] + several)

    @cached_property
    def _picture(self) -> Picture:
        """Return the walls of every connected map in its robot's colour."""
        colours = team_colours(list(self.grids))
        return overlay_picture([(self.grids[name], pose, colours[name])
                                for name, pose in self.world.items()])


def draw_team(axes: Axes, grids: Mapping[str, Grid], world: Mapping[str, Pose],
              paths: Mapping[str, Array]) -> None:
    """Draw a team once: see `TeamData`."""
    TeamData(grids, world, paths).draw(axes)
