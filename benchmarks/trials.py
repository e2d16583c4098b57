# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study simulated drives by the dozen: honest covariance, and rooms that look alike.

usage: python benchmarks/trials.py [nees [RUNS [FIRST]]] [lookalikes [RUNS [FIRST]]]
(default: nees 50 lookalikes 200; about 5 and 7 minutes of one core; FIRST: number of the first
run, 0; other numbers are other worlds, drives and noises)

nees prints the mean normalised estimation error squared of the current pose over the runs, at
several moments of a drive, with the band in which it lies in 95 % of all studies if the
covariance is honest. lookalikes prints how many loops were closed between different places, and
how many right ones were not believed. Asserts nothing.
"""

from collections import Counter
from collections.abc import Iterator
import sys

import numpy as np
from scipy.stats import chi2
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.loops import Loop
from somfusion_ros.slam.slam import Slam
from somfusion_ros.tools import drive
from somfusion_ros.tools.floor_plan import box, FloorPlan, PLANS, polygon, wall
from somfusion_ros.tools.laser import Laser, Scene
from somfusion_ros.tools.simulate import drive_robot, SimulationOptions
from somfusion_ros.tools.trial import Outcome, run_trial, SICK, simulate_trial, Trial

MOMENTS = (0.1, 0.25, 0.5, 0.75, 1.0)
FALSE = (0.5, 0.2)             # [m] [rad] beyond which a loop joins different places
SPARSE = Laser(beams=257, period=0.4, range_max=6.0)
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


def alike(rng: np.random.Generator) -> tuple[Array, Array]:
    """Walls and route: rooms of one size on both sides of a corridor, furnished nearly alike."""
    rooms, width, depth, aisle = 5, rng.uniform(3.2, 4.4), rng.uniform(3.0, 4.0), 1.8
    door, length = rng.uniform(0.35, 0.65) * width, rooms * width
    doors = [(k * width + door, 1.0) for k in range(rooms)]
    low, high, top = depth, depth + aisle, 2.0 * depth + aisle
    parts = [polygon([(0, 0), (length, 0), (length, top), (0, top)]),
             wall((0, low), (length, low), doors), wall((0, high), (length, high), doors)]
    cupboard = rng.uniform(0.5, 1.4, 2)
    for k in range(rooms):
        if k:
            parts += [wall((k * width, 0), (k * width, low)),
                      wall((k * width, high), (k * width, top))]
        for y in (0.3, top - 0.3):
            if rng.random() < 0.8:
                parts.append(box(k * width + 0.8, y, *cupboard))
    at, middle, visited = [k * width + door for k in range(rooms)], low + 0.5 * aisle, []
    for k in rng.integers(0, rooms, 5):
        room = 0.45 * depth if rng.random() < 0.5 else top - 0.45 * depth
        visited += [(at[k], middle), (at[k], room), (at[k], middle)]
    return np.concatenate(parts), np.array(visited) + rng.uniform(-0.05, 0.05, (len(visited), 2))


class Witness:
    """Sits between matching and belief, and notes every loop that was found and believed."""

    def __init__(self, slam: Slam, trial: Trial) -> None:
        self._slam, self._trial, self._trusted = slam, trial, slam._loops.trusted
        self.counts: Counter[str] = Counter()
        slam._loops.trusted = self

    def __call__(self, loop: Loop, *rest: object) -> list:
        """Count, then believe what the SLAM believes."""
        self.counts[f'found {self._truth(loop.relation)}'] += 1
        believed = self._trusted(loop, *rest)
        self.counts.update(f'believed {self._truth(relation)}' for relation in believed)
        return believed

    def _truth(self, relation: object) -> str:
        known = self._slam._memory.stamps      # its lock is held here
        stamps = np.array([known[relation.first], known[relation.second]])
        x, y, theta = between(between(*self._trial.truth(stamps)), relation.z)
        return 'false' if np.hypot(x, y) > FALSE[0] or abs(theta) > FALSE[1] else 'true'


def look_alike_trial(number: int) -> tuple[Counter[str], Outcome]:
    """Drive among rooms that look alike with a poor odometry and a short-sighted laser."""
    rng = np.random.default_rng(number)
    plan = PLANS['symmetric']() if number % 8 == 0 else FloorPlan(np.zeros((0, 4)), (0, 0), ())
    walls, route = (plan.segments, plan.route(number // 8)) if plan.routes else alike(rng)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = drive.follow(route, heading, 0.6, 90.0)
    trial = simulate_trial(lambda t: Scene(walls), stamps, poses, SPARSE, rng,
                           drive.real_wheels(2.0 * WHEEL_ERROR, rng), slip=0.03)
    slam = Slam()
    counts = Witness(slam, trial).counts
    return counts, run_trial(trial, slam=slam)


def print_consistency(runs: int, first: int = 0) -> None:
    """Print the table of NEES."""
    rows: dict[str, list[Array]] = {}
    for name, nees, _ in consistency(range(first, first + runs)):
        rows.setdefault(name, []).append(nees)
    print('NEES of the current pose, 3 degrees of freedom; after share of the drive:')
    print(f'{"":22} runs ' + ' '.join(f'{moment:6.2f}' for moment in MOMENTS))
    every = np.concatenate(list(rows.values()))
    for name, values in [*sorted(rows.items()), ('all', every)]:
        print(f'{name:22} {len(values):4} '
              + ' '.join(f'{v:6.2f}' for v in np.mean(values, axis=0)))
    low, high = chi2.ppf((0.025, 0.975), 3 * runs) / runs
    print(f'95 % band of the mean over {runs} runs: {low:.2f} .. {high:.2f}', flush=True)


def print_look_alikes(runs: int, first: int = 0) -> None:
    """Print how loops among look-alike rooms fared."""
    counts, errors = Counter(), []
    for number in range(first, first + runs):
        found, outcome = look_alike_trial(number)
        counts.update(found)
        errors.append(outcome.distance.max())
    lost = counts['found true'] - counts['believed true']
    print(f'look-alike rooms, {runs} runs: {counts["believed false"]} false loops believed of '
          f'{counts["found false"]} found; {counts["believed true"]} true ones believed, '
          f'{lost} of {counts["found true"]} found not')
    print(f'largest error of a trajectory: median {np.median(errors):.2f} m, '
          f'95 % {np.percentile(errors, 95):.2f} m, worst {max(errors):.2f} m', flush=True)


def main() -> None:
    """Run the named studies."""
    studies = {'nees': (print_consistency, 50), 'lookalikes': (print_look_alikes, 200)}
    asked: list[list[str]] = []
    for word in sys.argv[1:] or list(studies):
        if word in studies:
            asked.append([word])
        else:
            asked[-1].append(word)
    for name, *numbers in asked:
        study, runs = studies[name]
        study(*([int(number) for number in numbers] or [runs]))


if __name__ == '__main__':
    main()
