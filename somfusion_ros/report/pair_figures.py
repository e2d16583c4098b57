# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a pair: histograms of normals, correlation, J, both maps in one frame."""

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
import numpy as np
from somfusion_ros.geometry import apply, Pose
from somfusion_ros.report.agreement import compare
from somfusion_ros.report.map_figures import legend, show
from somfusion_ros.report.pair_data import PairData
from somfusion_ros.report.palette import AGREEMENT, BOTH, COLOURS, CONFLICT, ONE, PALE
from somfusion_ros.report.pictures import agreement_picture, overlay_picture


def draw_histograms(axes: Axes, data: PairData) -> None:
    """Draw the histograms of surface normals of both maps."""
    degrees = np.arange(360)
    for side, found in enumerate((data.trace.target, data.trace.source)):
        heights = np.asarray(found.histogram, float)
        heights = 100.0 * heights / max(heights.sum(), 1e-12)
        axes.fill_between(degrees, heights, color=COLOURS[side], alpha=0.35, linewidth=0)
        axes.plot(degrees, heights, color=COLOURS[side], linewidth=1.0)
    axes.set_title('Histograms of surface normals')
    axes.set_ylabel('share of wall [%]')
    legend(axes, [(data.target, COLOURS[0]), (data.source, COLOURS[1])])
    _degrees(axes, 'direction of normal [deg]')


def draw_correlation(axes: Axes, data: PairData) -> None:
    """Draw the circular cross-correlation of the histograms with the orientation found."""
    correlation = np.asarray(data.trace.correlation, dtype=float)
    axes.plot(np.arange(len(correlation)) * 360.0 / len(correlation), correlation,
              color='#333333', linewidth=1.1)
    marks = [(name, pose, colour) for name, pose, colour in (
        ('best', data.pose, COLOURS[2]), ('runner-up', data.runner_up, COLOURS[3]))
        if pose is not None]
    for name, pose, colour in marks:
        axes.axvline(np.degrees(pose.theta) % 360.0, color=colour, linewidth=1.4,
                     linestyle='-' if name == 'best' else '--')
    axes.set_title('Circular cross-correlation of the histograms')
    axes.set_ylabel('correlation')
    if marks:
        legend(axes, [(f'{name} {np.degrees(pose.theta) % 360.0:.1f} deg', colour)
                      for name, pose, colour in marks])
    _degrees(axes, 'turn of the source [deg]')


def _degrees(axes: Axes, name: str) -> None:
    """Label the x axis as directions over a full turn."""
    axes.set_xlim(0, 360)
    axes.set_xticks(np.arange(0, 361, 90))
    axes.set_xlabel(name)


def draw_performance(axes: Axes, data: PairData) -> None:
    """Draw J (10) over the iterations of Algorithm 2."""
    values = np.asarray(data.trace.alignment.performance_index, dtype=float)
    axes.plot(np.arange(1, len(values) + 1), values, 'o-', color=COLOURS[0], markersize=3.5)
    axes.set_title('Performance index J')
    axes.set_xlabel('iteration')
    axes.set_ylabel('J')
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def draw_fused(axes: Axes, data: PairData) -> None:
    """Draw both maps in the target's frame, one colour each."""
    _overlay(axes, data, data.pose, 'Fused map' if data.trace.alignment.accepted
             else 'Best pose found, refused')


def draw_runner_up(axes: Axes, data: PairData) -> None:
    """Draw both maps at the pose of the best rival."""
    rival = data.trace.alignment.runner_up
    _overlay(axes, data, data.runner_up, 'Runner-up' if rival is None else
             f'Runner-up, probability {rival.probability:.3f}')


def _overlay(axes: Axes, data: PairData, pose: Pose | None, title: str) -> None:
    """Draw both maps at a pose, or write that there is none."""
    if pose is None:
        return _nothing(axes, title, 'no pose found')
    target, source = data.grids
    show(axes, data.picture(f'pair {pose}', lambda: overlay_picture(
        [(target, Pose(), COLOURS[0]), (source, pose, COLOURS[1])])), title)
    legend(axes, [(data.target, COLOURS[0]), (data.source, COLOURS[1]), ('both', BOTH)])


def draw_paths(axes: Axes, data: PairData) -> None:
    """Draw both trajectories in the target's frame."""
    best, (target, source) = data.pose, data.grids
    if best is None:
        return _nothing(axes, 'Trajectories', 'no pose found')
    if not any(len(path) for path in data.paths):
        return _nothing(axes, 'Trajectories', 'no trajectories')
    show(axes, data.picture('pale pair', lambda: overlay_picture(
        [(target, Pose(), PALE), (source, best, PALE)])), 'Trajectories')
    for side, (path, pose) in enumerate(zip(data.paths, (Pose(), best))):
        if len(path):
            points = apply(pose, path[:, :2])
            axes.plot(points[:, 0], points[:, 1], color=COLOURS[side], linewidth=1.3)
            axes.plot(*points[0], 'o', color=COLOURS[side], markersize=5)
    legend(axes, [(data.target, COLOURS[0]), (data.source, COLOURS[1])])


def draw_agreement(axes: Axes, data: PairData) -> None:
    """Draw where the maps agree and where they contradict each other."""
    if data.pose is None:
        return _nothing(axes, 'Agreement', 'no pose found')
    V, (target, source), pose = data.trace.alignment.verification_index, data.grids, data.pose
    show(axes, data.picture('agreement', lambda: agreement_picture(
        target, source, pose, compare(target, source, pose))), f'Agreement, V = {V:.1f} %')
    legend(axes, [('agreement', AGREEMENT), ('conflict', CONFLICT),
                  ('seen by one', ONE)])


def _nothing(axes: Axes, title: str, text: str) -> None:
    """Write why there is nothing to draw."""
    axes.set_title(title)
    axes.text(0.5, 0.5, text, ha='center', va='center', transform=axes.transAxes,
              color='#666666')
    axes.set_xticks([])
    axes.set_yticks([])
