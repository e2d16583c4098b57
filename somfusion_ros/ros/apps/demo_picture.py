# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One picture of a live team: the global map as every robot published it, and the team in it."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from somfusion_ros.geometry import Pose
from somfusion_ros.io.result import read_evidence
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.report.map_figures import show
from somfusion_ros.report.pictures import map_picture, write_figure
from somfusion_ros.report.team_figures import draw_team
from somfusion_ros.ros.apps.demo_table import Row

HEIGHT, WIDTH = 4.6, 5.4   # [inch] of a panel
NAME = 'live.png'


def draw_live(folder: Path, robots: Sequence[str], rows: Sequence[Row]) -> Path:
    """
    Draw what the recorder wrote to folder/live.

    One panel per robot with the global map as that robot published it, and a last one with every
    robot's own walls and path, placed by the transforms that the first robot published.
    """
    with matplotlib.rc_context({'font.size': 9}):
        figure = Figure(figsize=(WIDTH * (len(robots) + 1), HEIGHT), layout='constrained')
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(robots) + 1)
        live = folder / 'live'
        for axis, robot in zip(axes, robots):
            show(axis, map_picture(read_evidence(live / robot / 'global_map')),
                 f'global map published by {robot}')
        own = {robot: read_evidence(live / robot / 'map') for robot in robots}
        paths = {robot: read_tum(live / robot / 'path.tum')[1] for robot in robots}
        placed = {robots[0]: Pose(), **{row.source: row.T_target_source for row in rows
                                        if row.target == robots[0]}}
        draw_team(axes[-1], own, placed, paths)
        path = folder / NAME
        write_figure(path, figure, dpi=110)
    return path
