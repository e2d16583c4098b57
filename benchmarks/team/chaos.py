# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A year of faults an hour: teams in simulated time, with every fault that a seed chooses.

    python -m benchmarks.team.chaos --seeds 0 100      # a campaign
    python -m benchmarks.team.chaos --seed 17          # one seed again, and the faults that matter
"""

import argparse
from collections import Counter
import time

from somfusion_ros.simulation.chaos.campaign import run_seed, shrink
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.tapes import record_all


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
    injected, broken, hours, start = Counter[str](), Counter[str](), 0.0, time.monotonic()
    accepted = joined = runs = 0
    for seed in range(*options.seeds):
        if time.monotonic() - start > 60.0 * options.minutes:
            break
        outcome = run_seed(seed, tapes, matching)
        runs, hours = runs + 1, hours + outcome.seconds / 3600.0
        accepted, joined = accepted + outcome.accepted, joined + outcome.joined
        injected.update(fault.kind for fault in outcome.faults)
        if outcome.broken:
            broken.update(fault.kind for fault in outcome.faults)
            print(f'seed {seed}: {outcome.broken[0]}', flush=True)
    print(f'{runs} seeds, {hours:.1f} h of team time in {time.monotonic() - start:.0f} s, '
          f'{joined} ended joined, {accepted} accepted transforms checked, matched '
          f'{matching.done} of {matching.asked} times')
    print('| fault | injected | in runs that broke |\n|---|---|---|')
    for kind, count in sorted(injected.items()):
        print(f'| {kind} | {count} | {broken[kind]} |')


if __name__ == '__main__':
    main()
