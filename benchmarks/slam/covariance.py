# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study, by the dozen of simulated drives, whether the covariance is honest.

usage: python -m benchmarks.slam.covariance [RUNS [FIRST]]
       (default: 50 0; about 5 minutes of a core)

Prints the mean normalised estimation error squared of the current pose over the runs, at several
moments of a drive, with the band in which it lies in 95 % of all studies if the covariance is
honest. FIRST is the number of the first run: other numbers are other drives and noises. Asserts
nothing.
"""

from collections.abc import Iterator
import sys

from benchmarks.tables import Table
import numpy as np
from scipy.stats import chi2
from somfusion_ros.geometry import Array
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.simulate import drive_robot, SimulationOptions
from somfusion_ros.simulation.trial import Outcome, run_trial, SICK, simulate_trial, Trial

MOMENTS = (0.1, 0.25, 0.5, 0.75, 1.0)
WHEEL_ERROR = 0.03


def honest_trial(number: int) -> tuple[str, Trial]:
    """Drive in one of the four plans, with one of two lasers and wheels of its own."""
    rng, name = np.random.default_rng(number), sorted(PLANS)[number % 4]
    laser, plan = (Laser(), SICK)[number // 4 % 2], PLANS[name]()
    run = drive_robot(plan, number // 8, SimulationOptions(plan=name), rng)
    return f'{name}, {laser.beams} beams', simulate_trial(
        lambda t: Scene(plan.segments), run.stamps, run.poses, laser, rng,
        drive.real_wheels(WHEEL_ERROR, rng))


def consistency(numbers: range) -> Iterator[tuple[str, Array, Outcome]]:
    """Run trials; yield each one's name, its NEES at MOMENTS (K,), and all of its outcome."""
    for number in numbers:
        name, trial = honest_trial(number)
        outcome = run_trial(trial)
        last = len(outcome.nees) - 1
        yield name, outcome.nees[[int(moment * last) for moment in MOMENTS]], outcome


def consistency_table(runs: int, first: int = 0) -> Table:
    """Return the mean NEES of the current pose, by building and laser, and of all drives."""
    rows: dict[str, list[Array]] = {}
    for name, nees, _ in consistency(range(first, first + runs)):
        rows.setdefault(name, []).append(nees)
    every = np.concatenate(list(rows.values()))
    table = Table('covariance', ('after a share of the drive', 'drives',
                                 *(f'{moment:.2f}' for moment in MOMENTS)),
                  (None, 0, *[1] * len(MOMENTS)))
    for name, values in [*sorted(rows.items()), ('all', every)]:
        table.add(name, len(values), *np.mean(values, axis=0).tolist())
    low, high = chi2.ppf((0.025, 0.975), 3 * runs) / runs
    table.add(f'honest: in 95 % of such studies {low:.2f} to {high:.2f}', runs,
              *[3.0] * len(MOMENTS))
    return table


if __name__ == '__main__':
    print(consistency_table(*([int(word) for word in sys.argv[1:]] or [50])).markdown())
