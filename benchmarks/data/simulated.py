# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Make a data folder of simulated worlds, for those who have no recorded data.

usage: python -m benchmarks.data.simulated OUT

Writes what `folders.py` describes: two robots in every floor plan, with the truth and relations of
it, teams of the same plan and of different ones, and pairs of drawn maps. The same every time.
"""

import csv
from itertools import pairwise
from pathlib import Path
import shutil
import sys
from tempfile import TemporaryDirectory

from benchmarks.data.map_pairs import PairFolder
from benchmarks.fusion import cases
import numpy as np
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.simulate import simulate, SimulationOptions

TRUE_KINDS, DIFFERENT_KINDS = ('corridor', 'office', 'building'), ('corridors', 'storeys')
PAIRS_OF_A_KIND = 10
RELATIONS = 300        # true relative poses per log
APART = 60.0           # [s] between the two moments of a relation at most


def make(out: Path) -> None:
    """Write logs, teams and pairs."""
    names = [write_plan(out / 'logs', plan) for plan in sorted(PLANS)]
    strangers = [(f'{a} and {b}', (a, b)) for (a, _), (b, _) in pairwise(names)]
    with open(out / 'teams.csv', 'w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(('team', 'logs', 'note'))
        writer.writerows((two[0].rpartition('_')[0], ' '.join(two), 'two robots of one plan')
                         for two in names)
        writer.writerows((name, ' '.join(two), 'different places: must be refused')
                         for name, two in strangers)
    write_pairs(out / 'pairs')


def write_plan(logs: Path, plan: str) -> tuple[str, str]:
    """Simulate two robots in a plan; return the names of their logs."""
    names = f'{plan}_1', f'{plan}_2'
    with TemporaryDirectory() as folder:
        simulate(folder, SimulationOptions(robots=2, plan=plan))
        for number, name in enumerate(names, start=1):
            shutil.rmtree(logs / name, ignore_errors=True)
            shutil.copytree(Path(folder) / f'robot{number}', logs / name)
            write_relations(logs / name)
    return names


def write_relations(log: Path) -> None:
    """Write true relative poses between random moments of a log."""
    stamps, poses = read_tum(log / 'reference.tum')
    rng = np.random.default_rng(0)
    first = rng.integers(len(stamps), size=RELATIONS)
    later = np.searchsorted(stamps, stamps[first] + rng.uniform(0.0, APART, RELATIONS))
    later = np.minimum(later, len(stamps) - 1)
    rows = np.column_stack([stamps[first], stamps[later], between(poses[first], poses[later])])
    np.savetxt(log / 'relations.txt', rows[later > first], '%.6f', header='t1 t2 x y theta')


def write_pairs(folder: Path) -> None:
    """Draw pairs of maps, the source of each in a frame of its own."""
    with PairFolder(folder, 'drawn') as pairs:
        for kind in (*TRUE_KINDS, *DIFFERENT_KINDS):
            for number in range(PAIRS_OF_A_KIND):
                case = cases.make(kind, None, number)
                if case is None:
                    continue
                T, truth = np.zeros(3), None
                if case.truth is not None:
                    T = np.random.default_rng(number).uniform((-9, -9, -3.1), (9, 9, 3.1))
                    truth = compose(case.truth, between(T, np.zeros(3)))
                source = case.source
                moved = Grid(source.evidence, source.resolution,
                             Pose.from_array(compose(T, source.T_frame_grid)))
                pairs.add((f'{kind} {number}', f'{kind} {number}'), case.target, moved, truth)


if __name__ == '__main__':
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    make(Path(sys.argv[1]))
