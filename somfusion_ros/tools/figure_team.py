# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figure of the whole team: the global map in one colour per robot, and all trajectories."""

from collections.abc import Mapping

from matplotlib.axes import Axes

from somfusion_ros.geometry import apply, Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.tools.figure_data import BOTH, overlay_picture, team_colours
from somfusion_ros.tools.figure_maps import legend, show


def draw_team(axes: Axes, grids: Mapping[str, Grid], world: Mapping[str, Pose],
              paths: Mapping[str, Array]) -> None:
    """Draw every connected robot's walls and trajectory in the world frame."""
    colours = team_colours(list(grids))
    placed = [(grids[name], pose, colours[name]) for name, pose in world.items()]
    show(axes, overlay_picture(placed), 'Global map of ' + ', '.join(world))
    for name, pose in world.items():
        if len(paths.get(name, ())):
            points = apply(pose, paths[name][:, :2])
            axes.plot(points[:, 0], points[:, 1], color=colours[name], linewidth=1.0, alpha=0.8)
            axes.plot(*points[0], 'o', color=colours[name], markersize=5)
    entries = [(name, colours[name]) for name in world] + [('several', BOTH)] * (len(world) > 1)
    legend(axes, entries)
