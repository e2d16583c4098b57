# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A year of faults an hour: teams in simulated time, with every fault that a seed chooses.

    python -m benchmarks.team.chaos --seeds 0 100 --lines a.jsonl    # a campaign, a line per seed
    python -m benchmarks.team.chaos --tables a.jsonl b.jsonl         # the tables of what ran
    python -m benchmarks.team.chaos --seed 17       # one seed again, and the faults that matter
"""

import argparse
from collections import Counter
from collections.abc import Iterable
import gc
import json
from pathlib import Path
import time
from typing import Any

import numpy as np
from somfusion_ros.simulation.chaos.campaign import run_seed, shrink
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.records import Outcome
from somfusion_ros.simulation.chaos.tapes import record_all, Tape

EDGES = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.01)    # of probabilities
SAVED = 20      # seeds between two savings of what was matched


def main() -> None:
    """Run seeds, or print tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int)
    parser.add_argument('--seeds', type=int, nargs=2, default=(0, 20))
    parser.add_argument('--lines', type=Path, help='file to which a line per seed is added')
    parser.add_argument('--tables', type=Path, nargs='+', help='files of lines')
    parser.add_argument('--memory', type=Path,
                        help='folder in which processes share what they matched')
    options = parser.parse_args()
    if options.tables:
        print_tables([json.loads(line) for path in options.tables
                      for line in path.read_text().splitlines()])
        return
    tapes, matching = record_all(42.0), Matching()
    share(matching, options.memory, None)
    if options.seed is not None:
        explain(options.seed, tapes, matching)
        return
    print_tables(campaign(range(*options.seeds), tapes, matching, options.lines, options.memory))


def explain(seed: int, tapes: list[Tape], matching: Matching) -> None:
    """Run one seed, and print the faults that matter."""
    outcome = run_seed(seed, tapes, matching)
    if outcome.broken:
        outcome = shrink(outcome, tapes, matching)
    print(*(f'  {fault}' for fault in outcome.faults), sep='\n')
    print(*(outcome.broken or ['nothing broke']), sep='\n')


def campaign(seeds: Iterable[int], tapes: list[Tape], matching: Matching, lines: Path | None,
             memory: Path | None) -> list[dict[str, Any]]:
    """Run seeds, and return a record of each; print each that breaks at once."""
    records = []
    for seed in seeds:
        start = time.process_time()
        outcome = run_seed(seed, tapes, matching)
        records.append(record_of(outcome, time.process_time() - start))
        if outcome.broken:
            print(f'seed {seed}: {outcome.broken[0]}', flush=True)
        if lines:
            with lines.open('a') as file:
                file.write(json.dumps(records[-1]) + '\n')
        if len(records) % SAVED == 0:
            share(matching, memory, records[0]['seed'])
    return records


def share(matching: Matching, folder: Path | None, first: int | None) -> None:
    """Keep what the process with a first seed matched since then, and take what others did."""
    if folder and first is not None:
        count = len(list(folder.glob(f'{first}.*.matched')))
        matching.memory.save(folder / f'{first}.{count:05}.matched')
    for path in sorted(folder.glob('*.matched') if folder else ()):
        matching.memory.load(path)
    gc.freeze()    # what is remembered is for good, and takes long to look through for garbage


def record_of(outcome: Outcome, cpu: float) -> dict[str, Any]:
    """Return what the tables need of a run; cpu [s]."""
    return {'seed': outcome.seed, 'cpu': round(cpu, 2), 'seconds': outcome.seconds,
            'faults': [fault.kind for fault in outcome.faults], 'broken': outcome.broken,
            'accepted': outcome.accepted, 'bent': outcome.bent, 'agreed': outcome.agreed,
            'joined': outcome.joined, 'digest': outcome.digest.hex(),
            'stood': round(outcome.stood, 1),
            **{name: [(round(p, 4), right) for p, right in verdicts]
               for name, verdicts in (('judged', outcome.judged), ('alike', outcome.alike))}}


def print_tables(records: list[dict[str, Any]]) -> None:
    """Print what ran, which faults, and how well verdicts are calibrated."""
    total = Counter({key: sum(one[key] for one in records) for key in (
        'seconds', 'cpu', 'joined', 'accepted', 'bent', 'agreed')})
    broken = [one for one in records if one['broken']]
    print(f'{len(records)} seeds, {total["seconds"] / 3600.0:.1f} h of team time in '
          f'{total["cpu"]:.0f} s of CPU, {total["joined"]} joined at an end, '
          f'{total["accepted"]} accepted transforms checked, {total["bent"]} as views bend them, '
          f'{total["agreed"]} times all were to agree; {len(broken)} seeds broke an invariant: '
          f'{[one["seed"] for one in broken]}')
    injected = Counter(kind for one in records for kind in one['faults'])
    in_broken = Counter(kind for one in broken for kind in one['faults'])
    print('| fault | injected | in runs that broke |\n|---|---|---|')
    for kind, count in sorted(injected.items()):
        print(f'| {kind} | {count} | {in_broken[kind]} |')
    for name in ('judged', 'alike'):
        print(name)
        print_calibration([(p, right) for one in records for p, right in one[name]])
    print(f'ends that look alike were taken for one for {max(one["stood"] for one in records)} s '
          'at most after the maps told them apart')


def print_calibration(judged: list[tuple[float, bool]]) -> None:
    """
    Print how often verdicts of a probability were right, of pairs of maps that are good.

    The same maps come again and again: those of one probability to four digits count once, too.
    """
    print('| probability | verdicts | mean | right | different ones | right |')
    print(6 * '|---' + '|')
    for low, high in zip(EDGES, EDGES[1:]):
        inside = [(p, right) for p, right in judged if low <= p < high]
        if inside:
            mean, right = np.mean(inside, axis=0)
            print(f'| {low:g} - {min(high, 1.0):g} | {len(inside)} | {mean:.3f} | {right:.3f} | '
                  f'{len({*inside})} | {np.mean([right for _, right in {*inside}]):.3f} |')


if __name__ == '__main__':
    main()
