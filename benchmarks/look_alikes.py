# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study simulated drives among places that look alike: which loops are believed.

usage: python benchmarks/look_alikes.py [RUNS [FIRST]]      (default: 200 0; 12 minutes of a core)

Four kinds of world take turns: rooms of one size that are furnished nearly alike; the same
unfurnished, so that any two rooms match; a building that is the same turned by 180 degrees; and
a round corridor with equal niches, one every metre or so. The laser is short-sighted and the
wheels slip so much that the next niche often lies within the filter's gate: that is counted, too.
Prints how many loops between different places were found, tempted (lay within the chi-square
gate) and were believed, and how many right ones were not believed. Asserts nothing.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
import sys

import numpy as np
from somfusion_ros.geometry import Array, between, squared_mahalanobis
from somfusion_ros.slam.loops import CHI2, Loop
from somfusion_ros.slam.slam import Slam
from somfusion_ros.tools import drive
from somfusion_ros.tools.floor_plan import box, PLANS, polygon, wall
from somfusion_ros.tools.laser import Laser, Scene
from somfusion_ros.tools.trial import Outcome, run_trial, simulate_trial, Trial

FALSE = (0.5, 0.2)             # [m] [rad] by which a loop that joins different places is wrong
SPARSE = Laser(beams=257, period=0.4, range_max=6.0)
WHEEL_ERROR = 0.06             # share by which the odometry's wheels are wrong
World = tuple[Array, Array, float]   # walls (S, 4), route (K, 2), slip [m] after one metre


def rooms(rng: np.random.Generator, furnished: bool) -> World:
    """Build rooms of one size on both sides of a corridor; unfurnished, they are all the same."""
    count = 5 if furnished else 7
    width, depth, aisle = rng.uniform(3.2, 4.4), rng.uniform(3.0, 4.0), 1.8
    if not furnished:
        width, depth = rng.uniform(2.2, 3.0), rng.uniform(2.2, 3.0)
    door, length = rng.uniform(0.35, 0.65) * width, count * width
    doors = [(k * width + door, 1.0) for k in range(count)]
    low, high, top = depth, depth + aisle, 2.0 * depth + aisle
    parts = [polygon([(0, 0), (length, 0), (length, top), (0, top)]),
             wall((0, low), (length, low), doors), wall((0, high), (length, high), doors)]
    cupboard = rng.uniform(0.5, 1.4, 2)
    for k in range(count):
        if k:
            parts += [wall((k * width, 0), (k * width, low)),
                      wall((k * width, high), (k * width, top))]
        for y in (0.3, top - 0.3):
            if furnished and rng.random() < 0.8:
                parts.append(box(k * width + 0.8, y, *cupboard))
    at, middle, visited = [k * width + door for k in range(count)], low + 0.5 * aisle, []
    for k in rng.integers(0, count, 5 if furnished else 7):
        room = 0.45 * depth if rng.random() < 0.5 else top - 0.45 * depth
        visited += [(at[k], middle), (at[k], room), (at[k], middle)]
    return np.concatenate(parts), np.array(visited), 0.03 if furnished else 0.1


def half_turn(rng: np.random.Generator) -> World:
    """Build what looks the same turned by 180 degrees."""
    plan = PLANS['symmetric']()
    return plan.segments, plan.route(int(rng.integers(2))), 0.06


def niches(rng: np.random.Generator) -> World:
    """
    Build a round corridor, smooth but for equal niches along a third of it.

    Along the smooth part nothing tells the laser how far the robot went, and where it comes
    round to the niches again, the next one may look nearer than the right one.
    """
    radius, aisle, depth = rng.uniform(7.0, 11.0), rng.uniform(1.6, 2.4), 0.35
    step = rng.uniform(0.8, 1.6) / radius                  # [rad] from one niche to the next
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    niche = (angle < 2.1) & (angle % step < 0.5 * step)
    parts = []
    for r, out in ((radius - 0.5 * aisle, -depth), (radius + 0.5 * aisle, depth)):
        r = r + np.where(niche, out, 0.0)
        parts.append(polygon(list(zip(r * np.cos(angle), r * np.sin(angle), strict=True))[:-1]))
    way = np.arange(0.3, 0.3 + 2.0 * np.pi + 2.0, 0.1)
    return np.concatenate(parts), radius * np.column_stack([np.cos(way), np.sin(way)]), 0.1


KINDS: dict[str, Callable[[np.random.Generator], World]] = {
    'rooms nearly alike': lambda rng: rooms(rng, True),
    'equal rooms': lambda rng: rooms(rng, False),
    'half turn': half_turn, 'niches': niches}


class Witness:
    """Sits between matching and belief, and notes every loop that was found and believed."""

    def __init__(self, slam: Slam, trial: Trial) -> None:
        self._slam, self._trial, self._trusted = slam, trial, slam._loops.trusted
        self.counts: Counter[str] = Counter()
        slam._loops.trusted = self

    def __call__(self, loop: Loop, ekf: object) -> list:
        """Count, then believe what the SLAM believes."""
        truth = self._truth(loop.relation)
        self.counts[f'found {truth}'] += 1
        self.counts[f'tempted {truth}'] += (
            squared_mahalanobis(*ekf.innovation(loop.relation)) < CHI2)
        believed = self._trusted(loop, ekf)
        self.counts.update(f'believed {self._truth(relation)}' for relation in believed)
        return believed

    def _truth(self, relation: object) -> str:
        seen = self._slam._memory.stamps      # its lock is held here
        stamps = np.array([seen[relation.first], seen[relation.second]])
        x, y, theta = error = between(between(*self._trial.truth(stamps)), relation.z)
        known = squared_mahalanobis(error, relation.R) > CHI2     # to the match, not only guessed
        return ('false' if known and (np.hypot(x, y) > FALSE[0] or abs(theta) > FALSE[1])
                else 'true')


def look_alike_trial(number: int) -> tuple[str, Counter[str], Outcome]:
    """Drive among places that look alike; give the kind, what happened to loops, and the rest."""
    rng, kind = np.random.default_rng(number), list(KINDS)[number % len(KINDS)]
    walls, route, slip = KINDS[kind](rng)
    route = route + rng.uniform(-0.05, 0.05, route.shape)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = drive.follow(route, heading, 0.6, 160.0)
    trial = simulate_trial(lambda t: Scene(walls), stamps, poses, SPARSE, rng,
                           drive.real_wheels(WHEEL_ERROR, rng), slip)
    trial = replace(trial, slip=[None] * len(trial.slip))     # odometry of an unknown kind
    slam = Slam()
    counts = Witness(slam, trial).counts
    return kind, counts, run_trial(trial, slam=slam)


def main() -> None:
    """Print how loops among look-alike places fared."""
    runs, first = (*map(int, sys.argv[1:]), *(200, 0)[len(sys.argv) - 1:])
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in (*KINDS, 'all')}
    worst: dict[str, list[float]] = {kind: [] for kind in counts}
    for number in range(first, first + runs):
        kind, found, outcome = look_alike_trial(number)
        for name in (kind, 'all'):
            counts[name].update(found)
            worst[name].append(float(outcome.distance.max()))
    print(f'{"":24} false loops               true loops        largest error [m]')
    print('world               runs found tempted believed    found not believed  median  95 %')
    for name, c in counts.items():
        print(f'{name:19} {len(worst[name]):4} {c["found false"]:5} {c["tempted false"]:7} '
              f'{c["believed false"]:8} {c["found true"]:8} '
              f'{c["found true"] - c["believed true"]:12} '
              f'{np.median(worst[name]):7.2f} {np.percentile(worst[name], 95):5.2f}')


if __name__ == '__main__':
    main()
