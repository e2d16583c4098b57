# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Who is accepted, at which probability, and how well calibrated that probability is.

usage: python -m benchmarks.fusion.calibration DATA [--replays DIR ...] [--share S]
           [--kinds NAME ...] [--jobs N] [--write]
       python -m benchmarks.fusion.calibration DATA [--replays DIR ...] --fresh N [--begin K]
       python -m benchmarks.fusion.calibration --refit [--write]

DATA holds the folders pairs, pairs_mesh and pairs_floors. Judges true pairs of maps and pairs of
different places of every kind that cases.py makes of them, of maps that `somfusion replay` wrote,
and of drawn maps; learns the weights of the verdict anew; judges each case by weights learned
without its places; and prints, per kind and per threshold, how many are accepted. With --write
the table of measures of all cases, the weights that the package uses, with what they reach, and
the reliability diagram of doc/verdict.md are written anew; --refit judges no more cases than those
of the table. With --fresh, N pairs of different places are made that nothing was learned from,
some of kinds of which none was, and judged; --begin throws other dice. What was judged is kept
below build/ as long as code and data stay what they are: a command that was stopped goes on
where it was.
"""

import argparse
import json
import os
from pathlib import Path
import sys

from benchmarks.data.folders import ROOT
from benchmarks.fusion import cases
from benchmarks.fusion.judging import data_files, digest, judge
from benchmarks.fusion.verdict_fit import (fit, left_out, log_odds, read_samples, Sample, TABLE,
                                           write_samples)
from benchmarks.fusion.verdict_tables import (calibration_errors, calibration_table,
                                              draw_reliability, kinds_table, thresholds_table)
from benchmarks.tables import commit
import numpy as np
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Array
from somfusion_ros.whole_files import write_text

WEIGHTS = ROOT / 'somfusion_ros' / 'fusion' / verdicts.WEIGHTS_FILE
DIAGRAM = ROOT / 'doc' / 'verdict_reliability.png'
FRESH_FROM = 10_000     # numbers of cases that are in no table
FRESH = {'crossed': 35, 'corridors': 12, 'windows': 12, 'buildings': 7, 'offices': 7, 'hole': 6,
         'storeys': 5, 'real_storeys': 5, 'gap': 4, 'wings': 4, 'mesh_false': 3}     # in a hundred


def queue(share: float, wanted: list[str] | None) -> list[tuple[str, int]]:
    """List kinds and numbers of cases: the real ones, then a share of each kind in turns."""
    turns = []
    for kind, (_, count) in cases.kinds().items():
        if wanted and kind not in wanted:
            continue
        real = kind in cases.REAL
        count = count if real or not count else max(1, round(count * share))
        turns += [(-1.0 if real else (k + 0.5) / count, kind, k) for k in range(count)]
    return [(kind, number) for _, kind, number in sorted(turns)]


def fresh_queue(total: int, begin: int = FRESH_FROM) -> list[tuple[str, int]]:
    """List pairs of different places that no table holds, mixed as FRESH says, from a number."""
    turns = [((k + 0.5) / share, kind, begin + k) for kind, share in FRESH.items()
             for k in range(share * total // sum(FRESH.values()))]
    return [(kind, number) for _, kind, number in sorted(turns)]


def judged(samples: list[Sample]) -> tuple[dict[str, dict[str, float]], dict[str, Array]]:
    """Learn the weights; return them, and the probabilities (N,) by them and by left out ones."""
    weights = fit(samples)
    return weights, {'learned from all': verdicts.chance_of(log_odds(weights, samples)),
                     'places left out in turn': left_out(samples)}


def report(samples: list[Sample], data: str, command: str, write: bool) -> None:
    """Learn the weights, print what they reach, and write all that if asked."""
    weights, chances = judged(samples)
    kinds, thresholds = kinds_table(samples, *chances.values()), thresholds_table(samples, chances)
    calibrated = calibration_table(samples, chances)
    print(thresholds.markdown(), kinds.markdown(), calibrated.markdown(), sep='\n\n')
    enough = FusionConfig().estimation_confidence
    for sample, chance in zip(samples, chances['places left out in turn'], strict=True):
        if chance >= enough and not sample.right:
            print(f'wrongly accepted without its place: {sample.kind} {sample.number} '
                  f'at {chance:.3f}', file=sys.stderr)
    if not write:
        return
    errors = calibration_errors(samples, chances['places left out in turn'])
    record = {'command': command, 'commit': commit(), 'data': data,
              'true cases': sum(s.true for s in samples),
              'false cases': sum(not s.true for s in samples), 'weights': weights,
              'calibration error, places left out': errors,
              'kinds': [kinds.columns, *kinds.rows],
              'accepted at': [thresholds.columns, *thresholds.rows]}
    write_text(WEIGHTS, json.dumps(record, indent=1) + '\n')
    draw_reliability(DIAGRAM, chances, np.array([sample.right for sample in samples]))


def report_fresh(samples: list[Sample]) -> None:
    """Print how many pairs of different places the weights in use accept, by kind."""
    chances = verdicts.chance_of(log_odds(verdicts.weights(), samples))
    enough = FusionConfig().estimation_confidence
    for kind in dict.fromkeys(sample.kind for sample in samples):
        of_it = np.array([sample.kind == kind for sample in samples])
        print(f'{kind}: {(chances[of_it] >= enough).sum()} of {of_it.sum()}')
    for k in np.flatnonzero(chances >= enough):
        print(f'accepted: {samples[k].kind} {samples[k].number} at {chances[k]:.3f}')
    print(f'{(chances >= enough).sum()} of {len(samples)} accepted at {enough}')


def main() -> None:
    """Collect or read the cases, and report."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('data', type=Path, nargs='?')
    parser.add_argument('--replays', type=Path, nargs='*', default=[],
                        help='folders that somfusion replay wrote')
    parser.add_argument('--share', type=float, default=1.0, help='share of all cases')
    parser.add_argument('--kinds', nargs='*', help='only these')
    parser.add_argument('--fresh', type=int, help='judge so many new pairs of different places')
    parser.add_argument('--begin', type=int, default=FRESH_FROM,
                        help='number of the first of these of each kind')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='processes')
    parser.add_argument('--refit', action='store_true', help='read the cases from the table')
    parser.add_argument('--write', action='store_true')
    args = parser.parse_args()
    if not args.refit and not args.data:
        parser.error('name the data, or --refit')
    if args.refit:
        old = json.loads(WEIGHTS.read_text(encoding='utf-8'))
        report(read_samples(TABLE), old['data'], old['command'], args.write)
        return
    wanted = fresh_queue(args.fresh, args.begin) if args.fresh else queue(args.share, args.kinds)
    samples = judge(args.data, args.replays, wanted, args.jobs)
    if args.fresh:
        report_fresh(samples)
        return
    if args.write:
        write_samples(TABLE, samples)
    share = '' if args.share == 1.0 else f' SHARE={args.share}'
    report(samples, digest(data_files(args.data)), f'make calibrate{share}', args.write)


if __name__ == '__main__':
    main()
