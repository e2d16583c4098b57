# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how well a robot is found that is switched on anywhere in a log, in the map of another run.

usage: python -m benchmarks.slam.starts MAP_LOG LOG N [BEGIN END] [--in KIND]

LOG is localised in the map of MAP_LOG, as a state or, with `--in map.yaml`, as it is drawn; with
`--in resumed` the state grows on. It begins at N moments that are spread evenly from BEGIN to END
[s] of it (all of it). Compared is with the joint solution of both runs, as in
`benchmarks.slam.localisation`. Prints a row per start: metres driven until it was found, and how
many of them within 1 m of the map's views; scans after that, and at how many it was lost; how far
off it was (median, 95 %, most) [m], and the longest time [s] for which it was more than 1 m off.
A start whose robot is not found in 90 s says "never". Asserts nothing.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

from benchmarks.slam.localisation import Pair
from benchmarks.tables import Table
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.io.bags.log import Log, open_log
from somfusion_ros.offline.robot_run import run_robot

WRONG = 1.0     # [m] off
LENGTH = 90.0   # [s] of a log that are run from a start on


@dataclass
class Part(Log):
    """A part of a log, from a stamp [s] on."""

    begins: float = 0.0

    def __iter__(self) -> Iterator[Any]:
        """Yield the records of the part."""
        return (record for record in super().__iter__()
                if self.begins <= record.stamp < self.begins + LENGTH)


def part(log: Log, begins: float) -> Part:
    """Return a log from a stamp [s] on."""
    return Part(**{f.name: getattr(log, f.name) for f in fields(Log)}, begins=begins)


def longest(stamps: Array, wrong: Array) -> float:
    """Return the longest time [s] between stamps (n,) in a row that are wrong (n,)."""
    most, since = 0.0, None
    for stamp, is_wrong in zip(stamps, wrong, strict=True):
        since = (stamp if since is None else since) if is_wrong else None
        most = max(most, stamp - since if since is not None else 0.0)
    return most


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('map_log')
    parser.add_argument('log')
    parser.add_argument('n', type=int)
    parser.add_argument('range', type=float, nargs='*', help='BEGIN END [s]')
    parser.add_argument('--in', dest='kind', default='state',
                        choices=('state', 'map.yaml', 'resumed'))
    options = parser.parse_args()
    pair = Pair(open_log(options.map_log), open_log(options.log))
    first, last = pair.stamps[0], pair.stamps[-1]
    begin, end = options.range or (0.0, last - first - LENGTH / 3.0)
    beginning = pair.beginnings()[options.kind]
    table = Table('starts', ('start s', 'found after m', 'in the map m', 'scans', 'lost',
                             'median m', '95 % m', 'most m', 'wrong s'),
                  (1, 1, 1, None, None, 3, 3, 3, 1))
    for start in first + np.linspace(begin, end, options.n):
        run = run_robot(part(pair.log, start), beginning=beginning)
        if run.found is None:
            table.add(start - first, 'never', pair.driven(start, run.stamps[-1]), len(run.stamps),
                      *[None] * 5)
        else:
            off, _ = pair.off(run)
            stamps = run.stamps[run.stamps > run.found.stamp]
            table.add(start - first, run.found.metres, pair.driven(start, run.found.stamp),
                      len(off), run.counters.get('lost', 0),
                      *np.percentile(off[:, 0], (50, 95, 100)),
                      longest(stamps[:len(off)], off[:, 0] > WRONG))
        print(*table.rows[-1], flush=True)
    print(table.markdown())


if __name__ == '__main__':
    main()
