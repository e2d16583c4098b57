# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fusion of maps as the commands show it: with progress, and with its figures."""

from collections.abc import Mapping
from pathlib import Path

from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.grid import Grid
from somfusion_ros.io.console import progress_bar, say
from somfusion_ros.team.offline import fuse, Fusion
from somfusion_ros.team.view_set import ViewSet


def fuse_with_progress(grids: Mapping[str, Grid], config: FusionConfig, traced: bool,
                       views: Mapping[str, ViewSet] | None = None) -> Fusion:
    """Fuse maps by robot, see `somfusion_ros.team.offline.fuse`, behind a progress bar."""
    pairs = len(grids) * (len(grids) - 1) // 2
    with progress_bar('aligning', pairs, 'pair') as bar:
        return fuse(grids, config, traced, bar.update, views=views)


def draw(folder: Path, fusion: Fusion) -> None:
    """Draw the report from what is already computed."""
    from somfusion_ros.report.report import draw_report  # matplotlib takes a second to load
    traces = {(pair.target, pair.source): pair.trace for pair in fusion.pairs
              if pair.trace is not None}
    say(f'report: {draw_report(folder, traces)}')
