# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Make a folder of pairs from maps whose relative pose is known.

usage: python -m benchmarks.data.map_pairs LIST.csv OUT

LIST.csv has the columns place_target, target, place_source, source, x, y, theta. The maps are
map_server's YAML files, relative to the list: maps that robots saved, drawn floor plans, or images
that somebody aligned by hand. x [m], y [m], theta [rad] is the true pose of the source's frame in
the target's; they are empty for maps of different places. Writes OUT/manifest.csv and OUT/*.npz
in the form of `folders.py`.
"""

import csv
from pathlib import Path
import sys

from benchmarks.scores.teams import known_overlap
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import read_map
from somfusion_ros.team.global_map import merge_grids

COLUMNS = ('name', 'kind', 'source', 'place_target', 'place_source', 'overlap', 'x', 'y',
           'theta', 'centre_x', 'centre_y')


class PairFolder:
    """A folder of pairs that is being written; a context manager."""

    def __init__(self, folder: Path, origin: str) -> None:
        """Begin a folder of maps of one origin, a word for the column `source`."""
        self._folder, self._origin = folder, origin
        self._rows: list[tuple[str | float, ...]] = []

    def __enter__(self) -> 'PairFolder':
        self._folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        with open(self._folder / 'manifest.csv', 'w', encoding='utf-8', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(self._rows)

    def add(self, places: tuple[str, str], target: Grid, source: Grid,
            truth: Array | None = None) -> None:
        """Add a pair; truth: T_target_source (3,), None for different places."""
        kind = 'neg' if truth is None else 'pos'
        name = f'{kind}_{places[0]}_{places[1]}_{len(self._rows):03}'.replace(' ', '_')
        target, source = upright(target), upright(source)
        resolution = max(target.resolution, source.resolution)
        target, source = upright(target, resolution), upright(source, resolution)
        numbers: tuple[str | float, ...] = ('', '', '', '', '', '')
        if truth is not None:
            overlap, centre = known_overlap(target, source, truth)
            numbers = (round(overlap, 4), *np.round(truth, 6), *np.round(centre, 3))
        np.savez_compressed(
            self._folder / f'{name}.npz', target=target.to_occupancy(),
            source=source.to_occupancy(), resolution=resolution,
            target_origin=target.T_frame_grid[:2], source_origin=source.T_frame_grid[:2])
        self._rows.append((name, kind, self._origin, *places, *numbers))


def upright(grid: Grid, resolution: float | None = None) -> Grid:
    """Return a map drawn along the axes of its own frame, in its or another resolution."""
    if grid.T_frame_grid.theta == 0.0 and resolution in (None, grid.resolution):
        return grid
    return merge_grids({'map': grid}, {'map': np.zeros(3)}, resolution)


def convert(listed: Path, out: Path) -> int:
    """Write the folder that a list describes; return the number of pairs."""
    with open(listed, encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    with PairFolder(out, listed.stem) as folder:
        for row in rows:
            truth = (np.array([float(row[key]) for key in ('x', 'y', 'theta')])
                     if row['x'].strip() else None)
            folder.add((row['place_target'], row['place_source']),
                       *(read_map(listed.parent / row[side]) for side in ('target', 'source')),
                       truth)
    return len(rows)


if __name__ == '__main__':
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    print(f'{convert(Path(sys.argv[1]), Path(sys.argv[2]))} pairs')
