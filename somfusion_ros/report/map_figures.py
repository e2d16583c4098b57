# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of one map: the map, its segments, its clusters with normals, its Radon image."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.report.pair_data import PairData
from somfusion_ros.report.palette import COLOURS, PALE, WALL
from somfusion_ros.report.pictures import map_picture, Picture

if TYPE_CHECKING:
    from somfusion_ros.fusion.map_trace import MapTrace

SIDES = ('target', 'source')
READABLE = 600     # clusters that a figure can hold; of more it shows a detail
DETAIL = 8.0       # [m] half the side of a detail
RADON_STEP = 0.1   # [m] between two offsets in the trace's Radon image


def show(axes: Axes, picture: Picture, title: str) -> None:
    """Show a picture of a map, with metres along its sides."""
    image, extent = picture
    axes.imshow(image, extent=extent, origin='lower', interpolation='antialiased')
    metric(axes, title)


def metric(axes: Axes, title: str) -> None:
    """Label axes in metres, with one scale for both."""
    axes.set_title(title)
    axes.set_aspect('equal')
    axes.set_xlabel('x [m]')
    axes.set_ylabel('y [m]')


def picture(data: PairData, side: int, colour: str) -> Picture:
    """Return a map's picture with its walls in a colour."""
    return data.picture(f'{side} {colour}', lambda: map_picture(data.grids[side], colour))


def legend(axes: Axes, entries: Sequence[tuple[str, str]]) -> None:
    """Explain (name, colour) entries above the axes, where they hide nothing."""
    handles = [Line2D([], [], color=colour, linewidth=3) for _, colour in entries]
    axes.legend(handles, [name for name, _ in entries], loc='lower center', ncols=len(entries),
                bbox_to_anchor=(0.5, 1.0), borderaxespad=0.1, handlelength=1.0, frameon=False)
    axes.set_title(axes.get_title(), pad=18)


def label(data: PairData, side: int) -> str:
    """Return the name of a map and its role."""
    return f'{(data.target, data.source)[side]} ({SIDES[side]})'


def draw_map(axes: Axes, data: PairData, side: int) -> None:
    """Draw a map as it was given, with the robot's trajectory."""
    show(axes, picture(data, side, WALL), f'Map of {label(data, side)}')
    path = data.paths[side]
    if len(path):
        axes.plot(path[:, 0], path[:, 1], color=COLOURS[side], linewidth=1.0)
        axes.plot(*path[0, :2], 'o', color=COLOURS[side], markersize=4)


def draw_segments(axes: Axes, data: PairData, side: int) -> None:
    """Draw the segments of Algorithm 1 in colours that differ between neighbours."""
    segments = _map_trace(data, side).segments
    show(axes, picture(data, side, PALE), '')
    palette = _palette(len(segments))
    order = np.random.default_rng(1).permutation(len(segments))   # spreads the colours
    for points, k in zip(segments, order):
        axes.plot(points[:, 0], points[:, 1], 's', color=palette[k], markersize=1.3,
                  markeredgewidth=0)
    axes.set_title(f'{len(segments)} segments of {label(data, side)}')


def draw_clusters(axes: Axes, data: PairData, side: int) -> None:
    """Draw the neurons of the SOM and their point normals (Fig. 4); of a large map, a detail."""
    found = _map_trace(data, side)
    show(axes, picture(data, side, PALE), '')
    detail = len(found.clusters) > READABLE
    if detail:
        x, y = detail_centre(found.clusters)
        axes.set_xlim(x - DETAIL, x + DETAIL)
        axes.set_ylim(y - DETAIL, y + DETAIL)
    known = np.hypot(*found.normals.T) > 0.5 if len(found.normals) else np.zeros(0, bool)
    axes.plot(found.clusters[~known, 0], found.clusters[~known, 1], '.', color='#7A828A',
              markersize=2)
    at, normals = found.clusters[known], found.normals[known]
    length = 0.035 * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    axes.quiver(at[:, 0], at[:, 1], normals[:, 0], normals[:, 1], color=COLOURS[side],
                angles='xy', scale_units='xy', scale=1.0 / length, width=0.0024, headwidth=4,
                zorder=2)
    axes.plot(at[:, 0], at[:, 1], '.', color='black', markersize=1.5, zorder=3)
    axes.set_title(f'{len(found.clusters)} clusters of {label(data, side)}'
                   + (', detail' if detail else ''))


def detail_centre(clusters: Array) -> Array:
    """Find the cluster (2,) [m] around which a detail shows most clusters."""
    near = np.abs(clusters[::5, None] - clusters[None]).max(-1) < DETAIL
    centre: Array = clusters[::5][near.sum(1).argmax()]
    return centre


def draw_radon(axes: Axes, data: PairData, side: int) -> None:
    """Draw the Radon image (5)-(8), its sharpness per direction, and the sharpest directions."""
    found = _map_trace(data, side)
    image = found.radon
    directions = np.degrees(found.radon_directions)
    used = np.flatnonzero(image.any(0))
    low, high = (used[0], used[-1] + 1) if len(used) else (0, image.shape[1])
    reach = 0.5 * (high - low) * RADON_STEP
    extent = (directions[0], directions[-1], -reach, reach)
    axes.imshow(np.sqrt(np.maximum(image[:, low:high].T, 0.0)), aspect='auto', origin='lower',
                cmap='magma', extent=extent, interpolation='antialiased')
    sharpness = found.radon_sharpness
    span = max(float(np.ptp(sharpness)), 1e-12)
    axes.plot(directions, (-0.98 + 0.45 * (sharpness - sharpness.min()) / span) * reach,
              color='#56B4E9', linewidth=1.2, label='sharpness')
    for number, k in enumerate(sharpest(sharpness)):
        axes.axvline(directions[k], color='white', linewidth=0.9, linestyle='--',
                     label=None if number else 'peaks')
    axes.legend(loc='upper right', labelcolor='white', facecolor='black')
    axes.set_title(f'Radon image of {label(data, side)}')
    axes.set_xlabel('direction [deg]')
    axes.set_ylabel('offset [m]')


def sharpest(sharpness: Array, count: int = 2, apart: float = 30.0) -> list[int]:
    """Find the indices of the highest values over half a turn, at least `apart` [deg] apart."""
    rest = np.array(sharpness, dtype=float)
    found: list[int] = []
    index = np.arange(len(rest))
    while len(found) < count and np.isfinite(rest).any() and np.nanmax(rest) > 0.0:
        k = int(np.nanargmax(rest))
        found.append(k)
        away = np.abs(index - k) * 180.0 / len(rest)
        rest[np.minimum(away, 180.0 - away) < apart] = np.nan
    return found


def _map_trace(data: PairData, side: int) -> 'MapTrace':
    """Return what was learned of one map."""
    return (data.trace.target, data.trace.source)[side]


def _palette(count: int) -> Array:
    """Return colours (count, 3) that are far apart in hue."""
    return np.asarray(colormaps['turbo'](np.linspace(0.03, 0.97, max(count, 1))))[:, :3] * 0.92
