# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion report`: the paper's figures for a result, on one page and one by one."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TYPE_CHECKING

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.io.console import progress_bar, say
from somfusion_ros.io.errors import InputError, reason_of
from somfusion_ros.io.parameters import make
from somfusion_ros.io.result import read_evidence, read_result
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.report import map_figures, pair_figures
from somfusion_ros.report.elastic_figure import before_and_after, elastic_team
from somfusion_ros.report.pair_data import PairData
from somfusion_ros.report.pictures import write_figure
from somfusion_ros.report.team_figures import TeamData
from somfusion_ros.report.verdict_panel import draw_verdict, verdict_word

if TYPE_CHECKING:
    from somfusion_ros.fusion.alignment import Trace

Panel = Callable[[Axes, PairData], None]
STYLE: Any = {   # of matplotlib's rcParams, whose names its type hints list one by one
    'font.size': 9, 'axes.titlesize': 10, 'axes.titleweight': 'bold', 'axes.labelsize': 8,
    'xtick.labelsize': 8, 'ytick.labelsize': 8, 'legend.fontsize': 8, 'axes.spines.top': False,
    'axes.spines.right': False, 'legend.frameon': True, 'legend.framealpha': 0.85,
    'legend.edgecolor': 'none', 'figure.dpi': 130}
PANEL = 4.4   # [inch]
PNG = {'compress_level': 4}


def both(draw: Callable[[Axes, PairData, int], None]) -> list[Panel]:
    """Return the two panels, target's and source's, of a figure that shows one map."""
    return [lambda axes, data: draw(axes, data, 0), lambda axes, data: draw(axes, data, 1)]


FIGURES: dict[str, list[Panel]] = {
    'maps': both(map_figures.draw_map),
    'fused': [pair_figures.draw_fused],
    'trajectories': [pair_figures.draw_paths],
    'segments': both(map_figures.draw_segments),
    'agreement': [pair_figures.draw_agreement],
    'runner_up': [pair_figures.draw_runner_up],
    'clusters': both(map_figures.draw_clusters),
    'radon': both(map_figures.draw_radon),
    'orientation': [pair_figures.draw_histograms, pair_figures.draw_correlation],
    'performance': [pair_figures.draw_performance],
    'verdict': [draw_verdict],
}

GLANCE: list[Panel] = [pair_figures.draw_fused, pair_figures.draw_agreement,
                       pair_figures.draw_runner_up, draw_verdict]


def report(folder: str | Path) -> Path:
    """Draw the report of a folder of replay or merge; InputError if it holds no result."""
    from somfusion_ros.fusion.alignment import trace
    folder = Path(folder)
    record = read_result(folder)
    config = make(FusionConfig, record.get('fusion_config', {}))
    grids = {name: read_evidence(folder / name) for name in record['robots']}
    traces, cache = {}, FusionCache()
    with progress_bar('aligning', len(record['pairs']), 'pair') as bar:
        for pair in record['pairs']:
            target, source = pair['target'], pair['source']
            traces[target, source] = trace(grids[target], grids[source], config, cache)
            bar.update()
    path = draw_report(folder, traces)
    say(f'report: {path}')
    return path


def draw_report(folder: Path, traces: Mapping[tuple[str, str], 'Trace']) -> Path:
    """
    Draw DIR/merge.png, DIR/report.png, DIR/elastic.png and DIR/figures/*.png.

    merge.png is for a glance: where the maps lie, where they agree and contradict each other, the
    runner-up, and the verdict. merge.png, report.png and the single figures show the most probable
    pair; report.png also shows the map of a team of three or more. Every other pair has a page of
    its own, DIR/figures/<target>_<source>.png. elastic.png shows the map before and after it was
    bent.
    """
    record = read_result(folder)
    grids = {name: read_evidence(folder / name) for name in record['robots']}
    paths = {name: _path(folder / name) for name in grids}
    world = {name: Pose(**pose) for name, pose in record['transforms'].items()}
    team = TeamData(grids, world, paths)
    figures = folder / 'figures'
    figures.mkdir(exist_ok=True)
    ranked = [PairData(a, b, (grids[a], grids[b]), traces[a, b], (paths[a], paths[b]))
              for a, b in sorted(traces, key=lambda pair: -traces[pair].alignment.probability)]
    drawings = {figures / 'team.png': partial(_team_figure, team)}
    bent = elastic_team(folder, world)
    if bent is not None:
        drawings[folder / 'elastic.png'] = partial(before_and_after, team, bent, record)
    if ranked:
        drawings[folder / 'merge.png'] = partial(
            panels_in_rows, GLANCE, ranked[0], 2, 1.5 * PANEL, _title(ranked[0]))
        drawings[folder / 'report.png'] = partial(_page, ranked[0], team)
        drawings |= {figures / f'{name}.png': partial(
            panels_in_rows, panels, ranked[0], len(panels), 1.35 * PANEL)
            for name, panels in FIGURES.items()}
    drawings |= {figures / f'{data.target}_{data.source}.png': partial(_page, data, team)
                 for data in ranked[1:]}
    with matplotlib.rc_context(STYLE), progress_bar('drawing', len(drawings), 'figure') as bar:
        for path, draw in drawings.items():
            write_figure(path, draw(), pil_kwargs=PNG)
            bar.update()
    return folder / 'report.png' if ranked else figures / 'team.png'


def panels_in_rows(panels: Sequence[Panel], data: PairData, columns: int, width: float,
                   title: str = '') -> Figure:
    """Draw panels, `width` [inch] wide each, with fixed room for their labels [inch]."""
    rows = -(-len(panels) // columns)
    height, head = 0.92 * width, 0.45 if title else 0.0
    size = columns * width, rows * height + head
    figure = Figure(figsize=size)
    figure.subplots_adjust(left=0.62 / size[0], right=1.0 - 0.12 / size[0],
                           bottom=0.5 / size[1], top=1.0 - (0.5 + head) / size[1],
                           wspace=0.6 / (width - 0.6), hspace=1.0 / (height - 1.0))
    figure.suptitle(title, fontsize=14, fontweight='bold', y=1.0 - 0.12 / size[1])
    for axes, draw in zip(np.ravel(figure.subplots(rows, columns)), panels):
        draw(axes, data)
    return figure


def _page(data: PairData, team: TeamData) -> Figure:
    """Draw all panels of a pair on one page, four in a row."""
    figures = FIGURES | ({'trajectories': [lambda axes, _: team.draw(axes)]}
                         if len(team.world) > 2 else {})
    panels = [panel for row in figures.values() for panel in row]
    return panels_in_rows(panels, data, 4, PANEL, _title(data))


def _title(data: PairData) -> str:
    """Return the verdict on a pair in one line."""
    found = data.trace.alignment
    return (f'{data.target} and {data.source}: {verdict_word(found)}, probability '
            f'{found.probability:.3f}, V {found.verification_index:.1f} %')


def _team_figure(team: TeamData) -> Figure:
    """Draw the team's figure."""
    figure = Figure(figsize=(2.0 * PANEL, 1.6 * PANEL), layout='constrained')
    team.draw(figure.subplots())
    return figure


def _path(folder: Path) -> Array:
    """Read the trajectory (N, 3) of a robot; empty where there is none."""
    path = folder / 'trajectory.tum'
    if not path.exists():
        return np.zeros((0, 3))
    try:
        return read_tum(path)[1]
    except (OSError, ValueError) as error:
        raise InputError(f'{path}: not a TUM trajectory ({reason_of(error)})') from error
