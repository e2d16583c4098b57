# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how a robot is found in a map of another year, since which furniture was moved.

usage: python -m benchmarks.another_year [STARTS [SEED [PIECES]]]      default 15 1 12
       (about ten minutes of a core)

In an office all of whose rooms are visited alike, and in one of which five are, a robot drives
for a quarter of an hour. Then none, half, or all pieces of furniture are moved, and it is started
at random places of its ways, at a random heading, in its state and in its map as drawn (map.yaml),
and drives on for up to 20 m. Prints a row each: starts, how many were found, metres driven until
then, how many believed in a wrong place at any time, scans that did, and the error [m] of all
others once found. Asserts nothing.
"""

import sys

from benchmarks.data.errands import rooms
from benchmarks.tables import Table
from benchmarks.week import PIECES, Week
import numpy as np
from somfusion_ros.geometry import between
from somfusion_ros.offline.beginning import Beginning, from_grid
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.trial import run_trial, simulate_trial
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.start import Start

METRES = 20.0   # of a drive, at most
WRONG = 0.5     # [m] by which a pose is of another place


class Fate:
    """How one start went: metres until found, or None, and errors [m] of what was told."""

    def __init__(self, week: Week, beginning: Beginning, rng: np.random.Generator) -> None:
        stamps, poses = week.somewhere(rng, METRES)
        trial = simulate_trial(lambda t: week.world.around(drive.at(stamps, poses, np.array(
            [t]))[0]), stamps, poses, week.laser, rng, drive.real_wheels(0.02, rng))
        slam = Slam(checkpoint=beginning.checkpoint, start=beginning.start)
        steps = run_trial(trial, slam=slam).steps
        truth = between(week.first, drive.at(stamps, poses, np.array([s.stamp for s in steps])))
        told = np.array([s.reason != 'lost' for s in steps])
        off = np.hypot(*(np.array([s.pose for s in steps]) - truth)[told, :2].T)
        self.metres = slam.found[0].metres if slam.found else None
        self.wrong, self.right = int(np.count_nonzero(off > WRONG)), off[off <= WRONG]


def main() -> None:
    """Print the table."""
    given = [int(arg) for arg in sys.argv[1:]]
    starts, seed, pieces = given + [15, 1, PIECES][len(given):]
    table = Table('another year', (
        'world', 'furniture moved', 'in the', 'starts', 'found', 'after m, median', 'largest',
        'believed wrongly', 'scans', 'error median m', '95 % m'),
        (*[None] * 5, 1, 1, None, None, 3, 3))
    for name, world in (('office', None), ('rooms', rooms())):
        week = Week(np.random.default_rng(seed), world, pieces)
        week.live(0.25)
        state = week.slam.checkpoint()
        ways = {'state': Beginning(state, Start(anywhere=True)),
                'map.yaml': from_grid(week.slam.grid())}
        for moved in (0, pieces // 2, pieces):
            week.move(moved)
            for how, beginning in ways.items():
                rng = np.random.default_rng(seed)
                fates = [Fate(week, beginning, rng) for _ in range(starts)]
                metres = [fate.metres for fate in fates if fate.metres is not None]
                right = np.concatenate([fate.right for fate in fates])
                table.add(name, f'{moved} of {pieces}', how, starts, len(metres),
                          float(np.median(metres or [np.nan])), max(metres, default=None),
                          sum(fate.wrong > 0 for fate in fates), sum(f.wrong for f in fates),
                          float(np.median(right)), float(np.percentile(right, 95)))
                print(' | '.join(table.rows[-1]), flush=True)
    print(table.markdown())


if __name__ == '__main__':
    main()
