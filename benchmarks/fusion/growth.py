# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how time and memory of a match grow with the size of the maps and the number of robots.

usage: python -m benchmarks.fusion.growth [--sides N ...] [--robots N ...]

Draws a campus of buildings, hands two robots two thirds of it each, one map turned, and matches
them in a process of its own. Then draws one building for a team whose robots saw a window each,
and matches all pairs. CPU time on one core; peak memory of the whole process with Python, NumPy,
SciPy and OpenCV, which need the amount of the first row's maps alone. Asserts nothing.
"""

import argparse
from collections.abc import Sequence
from itertools import combinations
import json
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time

from benchmarks.data import drawings, worlds
from benchmarks.data.folders import ROOT
from benchmarks.memory import peak_megabytes
from benchmarks.tables import Table
import cv2
import numpy as np
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.learning import learn
from somfusion_ros.grid import Grid

SIDES = (200, 400, 1000, 2000, 4000, 8000)   # cells along an edge
ROBOTS = (2, 4, 8, 16)


def campus(rng: np.random.Generator, side: int) -> Grid:
    """Draw a building of 40 m in every 100 m, or a smaller one, on `side` x `side` cells."""
    evidence, width = np.zeros((side, side), np.float32), min(40.0, side * drawings.CELL - 2.1)
    for row, column in np.ndindex(2 * (-(-side // 2000),)):
        house = drawings.building(rng, width, width).evidence
        part = evidence[2000 * row:, 2000 * column:][:house.shape[0], :house.shape[1]]
        part[:] = house[:part.shape[0], :part.shape[1]]
    return Grid(evidence, drawings.CELL)


def two_maps(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Two thirds each of one campus, as maps of `side` x `side` cells int8, one turned."""
    grid, width = campus(np.random.default_rng(side), side), side * drawings.CELL
    left, right = worlds.cut(grid, 0.0, 0.66 * width), worlds.cut(grid, 0.34 * width, width)
    return left.to_occupancy(), np.rot90(right.to_occupancy()).copy()


def match(file: Path) -> None:
    """Print the seconds of learning and matching a saved pair, peak MB and the verdict."""
    with np.load(file) as pair:
        grids = [Grid.from_occupancy(pair[name], drawings.CELL) for name in ('left', 'right')]
    seconds = []
    for copies in range(3 if max(grids[0].shape) < 3000 else 1):
        fresh = [Grid(grid.evidence, grid.resolution, (0.001 * copies, 0.0, 0.0))
                 for grid in grids]
        start, cache = time.process_time(), FusionCache()
        for grid in fresh:
            learn(grid, cache=cache)
        middle = time.process_time()
        found = align(*fresh, cache=cache)
        seconds.append((middle - start, time.process_time() - start))
    first, whole = np.median(seconds, axis=0)
    peak = peak_megabytes()
    print(json.dumps([500.0 * first, 1e3 * whole, peak, found.reason]))


def sizes_table(sides: Sequence[int] = SIDES) -> Table:
    """Return time and memory by the size of two maps of a campus."""
    table = Table('sizes', ('cells of each map', 'learn one map [ms]',
                            'the pair with learning [ms]', 'process [MB]', 'verdict'),
                  (None, 0, 0, 0))
    for side in sides:
        with TemporaryDirectory() as folder:
            file = Path(folder) / 'pair.npz'
            np.savez(file, **dict(zip(('left', 'right'), two_maps(side), strict=True)))
            row = subprocess.run(
                [sys.executable, '-m', 'benchmarks.fusion.growth', '--match', str(file)],
                cwd=ROOT, check=True, capture_output=True, text=True).stdout
        *numbers, reason = json.loads(row)
        table.add(f'{side} x {side}', *numbers, reason.partition(':')[0])
    return table


def robots_table(counts: Sequence[int] = ROBOTS) -> Table:
    """Return the time to match all pairs of a team once, by its size."""
    table = Table('robots', ('robots', 'pairs', 'accepted', 'all maps learned [ms]',
                             'all pairs matched once [ms]'), (None, 0, 0, 0, 0))
    for count in counts:
        rng, cache = np.random.default_rng(count), FusionCache()
        grid = drawings.building(rng, 50.0, 40.0)
        starts = rng.uniform(0.0, 30.0, count)
        grids = [worlds.turned(worlds.worn(worlds.cut(grid, x, x + 22.0), rng), rng)
                 for x in starts]
        start = time.process_time()
        for one in grids:
            learn(one, cache=cache)
        middle = time.process_time()
        found = [align(*pair, cache=cache) for pair in combinations(grids, 2)]
        end = time.process_time()
        table.add(count, len(found), sum(one.accepted for one in found),
                  1e3 * (middle - start), 1e3 * (end - middle))
    return table


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--sides', type=int, nargs='*', default=SIDES)
    parser.add_argument('--robots', type=int, nargs='*', default=ROBOTS)
    parser.add_argument('--match', type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.match:
        match(args.match)
    else:
        print(sizes_table(args.sides).markdown(), robots_table(args.robots).markdown(),
              sep='\n\n')


if __name__ == '__main__':
    main()
