# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One picture of a live team: the global map of every robot, and all walls robot by robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from somfusion_ros.geometry import apply, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.tools.live_words import Row
from somfusion_ros.tools.result import read_evidence

COLOURS = ('tab:blue', 'tab:orange', 'tab:green', 'tab:red', 'tab:purple', 'tab:brown')
HEIGHT, WIDTH = 4.2, 6.0   # [inch] of a panel
NAME = 'live.png'


def draw_live(folder: Path, robots: Sequence[str], rows: Sequence[Row]) -> Path:
    """
    Draw what the witness wrote to folder/live.

    One panel per robot with the global map as that robot published it, and a last one with the
    walls of every robot's own map, placed by the transforms that the first robot published.
    """
    figure, axes = plt.subplots(1, len(robots) + 1, squeeze=False, layout='constrained',
                                figsize=(WIDTH * (len(robots) + 1), HEIGHT))
    live = folder / 'live'
    for axis, robot in zip(axes[0], robots):
        grid = read_evidence(live / robot / 'global_map')
        _draw_grid(axis, grid)
        axis.set_title(f'global map published by {robot}')
    own = {robot: read_evidence(live / robot / 'map') for robot in robots}
    placed = {robots[0]: Pose(), **{row.source: row.T_target_source for row in rows
                                    if row.target == robots[0]}}
    _draw_walls(axes[0][-1], own, placed)
    for axis in axes[0]:
        axis.set_aspect('equal')
        axis.set_xlabel(f'x in the map of {robots[0]} [m]')
        axis.set_ylabel('y [m]')
    path = folder / NAME
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _draw_grid(axis: Any, grid: Grid) -> None:
    """Draw evidence in grey: walls black, unknown grey, free white; where known."""
    known = np.column_stack(np.nonzero(grid.known))
    corner = grid.cell_to_point(known) if len(known) else np.zeros((1, 2))
    x, y, theta = grid.T_frame_grid
    height, width = np.array(grid.shape) * grid.resolution
    image = axis.imshow(grid.evidence, cmap='gray', vmin=-1, vmax=1, origin='lower',
                        extent=(0, width, 0, height), interpolation='nearest')
    turn = plt.matplotlib.transforms.Affine2D().rotate(theta).translate(x, y)
    image.set_transform(turn + axis.transData)
    (left, low), (right, high) = corner.min(0) - 0.5, corner.max(0) + 0.5
    axis.set_xlim(left, right)
    axis.set_ylim(low, high)


def _draw_walls(axis: Any, grids: dict[str, Grid], placed: dict[str, Pose]) -> None:
    """Draw the walls of every placed map in its own colour."""
    for (robot, pose), colour in zip(placed.items(), COLOURS * len(placed)):
        points = apply(pose, grids[robot].points(grids[robot].occupied))
        axis.plot(*points.T, '.', markersize=1.5, color=colour, label=f"{robot}'s own map")
    axis.legend(loc='upper right', markerscale=8)
    axis.set_title(f'walls, as {next(iter(placed))} places them')
