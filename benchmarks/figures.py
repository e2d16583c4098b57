# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure every table of README and doc/ anew, and write it there.

usage: python -m benchmarks.figures [--data DIR] [--parts NAME ...] [--quick] [--print]

Each part ends by writing its tables between their markers, with data, commit and machine, so that
a long run can be stopped and gone on with. DIR is a folder of recorded data (DATASETS.md); without
it, and without SOMFUSION_DATA or ../shared/data, the same tables come from simulated worlds.
--quick takes a few cases of each kind, and says so under the tables; --print writes nothing.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import os
from pathlib import Path
import sys

from benchmarks import tables
from benchmarks.data import folders, simulated
from benchmarks.tables import Table

RESULTS = folders.ROOT / 'output' / 'figures'


@dataclass(frozen=True)
class Source:
    """Where the data lies, what to call it, and whether a few cases are enough."""

    data: Path
    name: str
    quick: bool = False

    @property
    def logs(self) -> list[Path]:
        """Logs whose SLAM is measured: one of each kind, or all of a folder without these."""
        from benchmarks.slam.accuracy import KINDS
        here = self.data / 'logs'
        found = [here / kind for kind in KINDS if (here / kind).is_dir()] or sorted(here.iterdir())
        return found[:2] if self.quick else found


Part = Callable[[Source], Iterator[Table]]


@dataclass
class Parts:
    """The parts by name; `parts.add` registers one."""

    known: dict[str, Part] = field(default_factory=dict)

    def add(self, part: Part) -> Part:
        """Register a part under its function's name."""
        self.known[part.__name__] = part
        return part


PARTS = Parts()


@PARTS.add
def slam(source: Source) -> Iterator[Table]:
    """Measure one robot on every kind of log: accuracy, time, memory."""
    from benchmarks.slam.accuracy import measured, slam_table, speed_table
    found = [measured(log) for log in source.logs]
    yield slam_table(found)
    yield speed_table(found)


@PARTS.add
def pairs(source: Source) -> Iterator[Table]:
    """Measure the merge of two maps on every set of pairs."""
    from benchmarks.fusion.stages import pairs_table
    yield pairs_table(folders.pair_sets(source.data), 10 if source.quick else 1)


@PARTS.add
def team(source: Source) -> Iterator[Table]:
    """Replay teams of robots from their logs."""
    from benchmarks.team.accuracy import team_table
    teams = folders.teams(source.data)
    yield team_table(teams[:1] + teams[-1:] if source.quick else teams, RESULTS / 'teams')


@PARTS.add
def stages(source: Source) -> Iterator[Table]:
    """Measure what each stage of the merge brings, and other methods."""
    from benchmarks.fusion.stages import load_all, stages_table
    yield stages_table(load_all(source.data / 'pairs', 20 if source.quick else 1))


@PARTS.add
def fusion_growth(source: Source) -> Iterator[Table]:
    """Measure the merge by the size of maps and the number of robots, in drawn worlds."""
    from benchmarks.fusion.growth import ROBOTS, robots_table, SIDES, sizes_table
    yield sizes_table(SIDES[:2] if source.quick else SIDES)
    yield robots_table(ROBOTS[:2] if source.quick else ROBOTS)


@PARTS.add
def calibration(source: Source) -> Iterator[Table]:
    """Count who is accepted at which probability, from the measures of `make calibrate`."""
    from benchmarks.fusion import calibration as study
    from benchmarks.fusion.verdict_fit import read_samples, TABLE
    samples = read_samples(TABLE)
    _, chances = study.judged(samples[::20] if source.quick else samples)
    samples = samples[::20] if source.quick else samples
    yield study.thresholds_table(samples, chances)
    yield study.kinds_table(samples, *chances.values())
    yield study.calibration_table(samples, chances)


@PARTS.add
def covariance(source: Source) -> Iterator[Table]:
    """Test in simulated drives whether the covariance is honest."""
    from benchmarks.slam.covariance import consistency_table
    yield consistency_table(4 if source.quick else 50, 0 if source.quick else 100)


@PARTS.add
def look_alikes(source: Source) -> Iterator[Table]:
    """Count the loops of simulated drives among places that look alike."""
    from benchmarks.slam.look_alikes import look_alikes_table
    yield look_alikes_table(5 if source.quick else 200)


@PARTS.add
def team_growth(source: Source) -> Iterator[Table]:
    """Measure a robot's share of the work by the size of its team, in fake rooms."""
    from benchmarks.team.growth import COUNTS, growth_table
    yield growth_table(COUNTS[:2] if source.quick else COUNTS)


@PARTS.add
def wire(source: Source) -> Iterator[Table]:
    """Measure what a team costs on the wire, with real nodes: needs root and ROS."""
    from benchmarks.team.network import COUNTS, wire_table
    yield wire_table(COUNTS[:1] if source.quick else COUNTS)


@PARTS.add
def live_cpu(source: Source) -> Iterator[Table]:
    """Measure what a robot of a live team costs, with real nodes at real rates: needs ROS."""
    from benchmarks.team.live_cpu import live_cpu_table
    yield live_cpu_table(2 if source.quick else 4)


def source_of(given: Path | None, quick: bool) -> Source:
    """Find the recorded data, or simulate some."""
    data = folders.data_folder(given)
    if data is not None:
        return Source(data, named('Recorded data', quick), quick)
    if given is not None:
        raise SystemExit(f'{given}: holds no folder logs/ (see benchmarks/DATASETS.md)')
    data = RESULTS / 'simulated'
    if not (data / 'pairs' / 'manifest.csv').exists():
        print('no recorded data: simulating ...', file=sys.stderr, flush=True)
        simulated.make(data)
    return Source(data, named('Simulated worlds', quick), quick)


def named(data: str, quick: bool) -> str:
    """Return what to call data under a table, so that a quick run is not taken for a whole one."""
    return f'{data}, a few cases of each kind only' if quick else data


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path)
    parser.add_argument('--parts', nargs='*', choices=list(PARTS.known), metavar='NAME',
                        help=', '.join(PARTS.known))
    parser.add_argument('--quick', action='store_true')
    parser.add_argument('--print', action='store_true')
    args = parser.parse_args()
    source, places = source_of(args.data, args.quick), tables.places()
    for name in args.parts or PARTS.known:
        if name == 'wire' and os.geteuid() and not args.parts:
            print('wire: left out, it needs root for its networks', file=sys.stderr)
            continue
        for table in PARTS.known[name](source):
            print(f'{table.name}\n{table.markdown()}\n', flush=True)
            if not args.print:
                tables.write_into(places[table.name], table, tables.origin(source.name))


if __name__ == '__main__':
    main()
