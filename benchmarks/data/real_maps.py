# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real maps for benchmarks: pairs of known relative pose, and maps of replayed logs."""

import csv
from functools import lru_cache
from itertools import combinations
import json
from pathlib import Path

import numpy as np
from somfusion_ros.geometry import Array, between, compose, fit, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import read_map
from somfusion_ros.io.trajectories import read_tum

Random = np.random.Generator


def load_pair(folder: Path, name: str) -> tuple[Grid, Grid]:
    """Read the target and the source of one pair; new Grid objects, nothing is learned yet."""
    pair = np.load(folder / f'{name}.npz')
    return tuple(Grid.from_occupancy(pair[side], float(pair['resolution']),
                                     (*pair[f'{side}_origin'], 0.0))
                 for side in ('target', 'source'))


def cropped(grid: Grid, margin: int = 10) -> Grid:
    """Cut off what is unknown around a map, but for a margin [cells]."""
    (top, bottom), (left, right) = (
        np.clip(np.flatnonzero(grid.known.any(axis))[[0, -1]] + (-margin, margin + 1), 0, side)
        for axis, side in ((1, grid.shape[0]), (0, grid.shape[1])))
    corner = compose(grid.T_frame_grid, (left * grid.resolution, top * grid.resolution, 0.0))
    return Grid(grid.evidence[top:bottom, left:right], grid.resolution, Pose.from_array(corner))


class RealMaps:
    """
    Maps of a folder of pairs, and of folders that `somfusion replay` wrote.

    The pairs' folder holds manifest.csv and one npz per pair. Logs of one place share the frame
    of the `reference.tum` beside their bag, which gives the true relative pose of their maps.
    """

    def __init__(self, pairs: Path, replays: list[Path]) -> None:
        """Read the list of pairs and all maps of replays."""
        self._folder = pairs
        self._others: dict[str, list] = {}
        with open(pairs / 'manifest.csv', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
        self._true = [row for row in rows if row['kind'] == 'pos']
        self._false = [row for row in rows if row['kind'] != 'pos']
        self._load = lru_cache(maxsize=24)(lambda name: tuple(
            cropped(grid) for grid in load_pair(pairs, name)))
        self._logs: dict[str, tuple[str, Grid]] = {}
        self.teams: list[tuple[set[str], Grid, Grid, Array, Array]] = []
        for folder in replays:
            self._add_replay(folder)

    @property
    def true_pairs(self) -> int:
        """Number of true pairs."""
        return len(self._true)

    @property
    def false_pairs(self) -> int:
        """Number of pairs of different places."""
        return len(self._false)

    def true_pair(self, number: int) -> tuple[set[str], Grid, Grid, Array, Array]:
        """Return places, target, source, truth (3,) and the middle (2,) of the overlap."""
        row = self._true[number % len(self._true)]
        numbers = (np.array([float(row[name]) for name in names])
                   for names in (('x', 'y', 'theta'), ('centre_x', 'centre_y')))
        return ({row['place_target']}, *self._load(row['name']), *numbers)

    def false_pair(self, number: int) -> tuple[set[str], Grid, Grid]:
        """Return places, target and source."""
        row = self._false[number]
        return {row['place_target'], row['place_source']}, *self._load(row['name'])

    def any_map(self, rng: Random) -> tuple[str, Grid]:
        """Draw a map with its place; one in five is that of a log."""
        if self._logs and rng.random() < 0.2:
            return self._logs[sorted(self._logs)[rng.integers(len(self._logs))]]
        row = (self._true + self._false)[rng.integers(len(self._true) + len(self._false))]
        side = int(rng.integers(2))
        return row[('place_target', 'place_source')[side]], self._load(row['name'])[side]

    def same_place(self, number: int, rng: Random) -> tuple[str, Grid, Grid]:
        """Return two maps of one place, or one map twice, with the place."""
        if number < len(self._true) or not self._logs:
            places, *grids, _, _ = self.true_pair(number)
            return min(places), grids[rng.integers(2)], grids[rng.integers(2)]
        place, grid = self._logs[sorted(self._logs)[number % len(self._logs)]]
        return place, grid, grid

    def other(self, folder: str) -> list:
        """Return the rows of a folder of pairs beside the first, with their maps."""
        path = self._folder.parent / folder
        if folder not in self._others:
            with open(path / 'manifest.csv', encoding='utf-8') as file:
                self._others[folder] = [(row, *load_pair(path, row['name']))
                                        for row in csv.DictReader(file)]
        return self._others[folder]

    def mesh_map(self, rng: Random) -> tuple[str, Grid]:
        """Draw a map of a depth camera's mesh, with its place."""
        rows = self.other('pairs_mesh')
        row, *grids = rows[rng.integers(len(rows))]
        return row['place_target'], grids[rng.integers(2)]

    def floor_map(self, rng: Random) -> tuple[str, Grid]:
        """Draw a map of a storey, with its place."""
        rows = self.other('pairs_floors')
        row, *grids = rows[rng.integers(len(rows))]
        return 'gdc', grids[rng.integers(2)]

    def _add_replay(self, folder: Path) -> None:
        """Read the maps of one replay, and pair them where they share a place."""
        record = json.loads((folder / 'result.json').read_text())
        found = []
        for robot, facts in record['robots'].items():
            log, grid = Path(facts['bag']).parent, read_map(folder / robot / 'map.yaml')
            place = log.name.removeprefix('mit-').split('_')[0]
            self._logs[f'{folder.name} {log.name}'] = place, grid
            found.append((place, grid, *_placed(folder / robot, log)))
        for (here, target, T_a, _), (there, source, T_b, spot) in combinations(found, 2):
            if here == there:
                self.teams.append(({here}, target, source, between(T_a, T_b), spot))


def _placed(robot: Path, log: Path) -> tuple[Pose, Array]:
    """Pose of a robot's map in the reference's frame, and the middle (2,) of its path."""
    (mine, poses), (true, reference) = (read_tum(path) for path in (
        robot / 'trajectory.tum', log / 'reference.tum'))
    inside = (true >= mine[0]) & (true <= mine[-1])
    at = np.column_stack([np.interp(true[inside], mine, axis) for axis in poses[:, :2].T])
    return fit(at, reference[inside, :2]), at.mean(0)
