# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Before and after: the robots' maps laid on one another rigidly, and bent into one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from somfusion_ros.geometry import Pose
from somfusion_ros.io.maps import read_map
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.report.team_figures import TeamData

WIDTH, HEIGHT = 14.0, 7.5   # [inch]
ABOVE_LEGEND = 22           # [pt]


def elastic_team(folder: Path, robots: Mapping[str, Pose]) -> TeamData | None:
    """Read the joint maps and paths of robots; None where one of them has none."""
    maps = {name: folder / name / 'joint_map.yaml' for name in robots}
    if len(robots) < 2 or not all(path.exists() for path in maps.values()):
        return None
    grids = {name: read_map(path) for name, path in maps.items()}
    paths = {name: read_tum(folder / name / 'joint.tum')[1] for name in robots}
    return TeamData(grids, dict.fromkeys(robots, Pose()), paths)


def before_and_after(before: TeamData, after: TeamData, record: Mapping[str, Any]) -> Figure:
    """Draw the rigid and the elastic map side by side, with what the walls say."""
    figure = Figure(figsize=(WIDTH, HEIGHT), layout='constrained')
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, team, word, key in ((left, before, 'rigid', 'walls_agree_rigid'),
                                  (right, after, 'elastic', 'walls_agree_elastic')):
        team.draw(axes)
        shares = [pair[key] for pair in record['pairs'] if pair.get(key) is not None]
        share = f': {100 * min(shares):.0f} % of the walls agree' if shares else ''
        axes.set_title(word + share, pad=ABOVE_LEGEND)
    return figure
