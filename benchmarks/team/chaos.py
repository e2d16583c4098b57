# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A year of faults an hour: teams in simulated time, with every fault that a seed chooses.

    python -m benchmarks.team.chaos --seeds 0 100      # a campaign
    python -m benchmarks.team.chaos --seed 17          # one seed again, and the faults that matter
"""

import argparse
from collections import Counter
from collections.abc import Iterable
import time

import numpy as np
from somfusion_ros.simulation.chaos.campaign import run_seed, shrink
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.records import Outcome
from somfusion_ros.simulation.chaos.tapes import record_all, Tape

EDGES = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.01)    # of probabilities


def main() -> None:
    """Run seeds, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int)
    parser.add_argument('--seeds', type=int, nargs=2, default=(0, 20))
    parser.add_argument('--minutes', type=float, default=1e9, help='stop after this time')
    options = parser.parse_args()
    tapes, matching = record_all(42.0), Matching()
    if options.seed is not None:
        outcome = run_seed(options.seed, tapes, matching)
        if outcome.broken:
            outcome = shrink(outcome, tapes, matching)
        print(*(f'  {fault}' for fault in outcome.faults), sep='\n')
        print(*(outcome.broken or ['nothing broke']), sep='\n')
        return
    campaign(range(*options.seeds), 60.0 * options.minutes, tapes, matching)


def campaign(seeds: Iterable[int], time_left: float, tapes: list[Tape], matching: Matching
             ) -> None:
    """Run seeds for a time [s] at most; print each that breaks at once, and tables at the end."""
    outcomes: list[Outcome] = []
    start = time.monotonic()
    for seed in seeds:
        if time.monotonic() - start > time_left:
            break
        outcomes.append(run_seed(seed, tapes, matching))
        if outcomes[-1].broken:
            print(f'seed {seed}: {outcomes[-1].broken[0]}', flush=True)
    print(f'{len(outcomes)} seeds, {sum(one.seconds for one in outcomes) / 3600.0:.1f} h of team '
          f'time in {time.monotonic() - start:.0f} s, {time.process_time():.0f} s of CPU, '
          f'{sum(one.joined for one in outcomes)} ended joined, '
          f'{sum(one.accepted for one in outcomes)} accepted transforms checked, '
          f'{sum(one.bent for one in outcomes)} as views bend them, matched {matching.done} of '
          f'{matching.asked} times')
    print_faults(outcomes)
    print_calibration([verdict for one in outcomes for verdict in one.judged])


def print_faults(outcomes: list[Outcome]) -> None:
    """Print how often each fault was injected, and how often in runs that broke."""
    injected = Counter(fault.kind for one in outcomes for fault in one.faults)
    broken = Counter(fault.kind for one in outcomes if one.broken for fault in one.faults)
    print('| fault | injected | in runs that broke |\n|---|---|---|')
    for kind, count in sorted(injected.items()):
        print(f'| {kind} | {count} | {broken[kind]} |')


def print_calibration(judged: list[tuple[float, bool]]) -> None:
    """Print how often verdicts of a probability were right, of pairs of maps that are good."""
    print('| probability | verdicts | mean | right |\n|---|---|---|---|')
    for low, high in zip(EDGES, EDGES[1:]):
        inside = [(p, right) for p, right in judged if low <= p < high]
        if inside:
            mean, right = np.mean(inside, axis=0)
            print(f'| {low:g} - {min(high, 1.0):g} | {len(inside)} | {mean:.3f} | {right:.3f} |')


if __name__ == '__main__':
    main()
