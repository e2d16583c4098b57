# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study simulated drives among places that look alike: which loops are believed.

usage: python -m benchmarks.slam.look_alikes [RUNS [FIRST]]
       (default: 200 0; about 20 minutes of a core)

Five kinds of world take turns: rooms of one size that are furnished nearly alike; the same
unfurnished, so that any two rooms match; a building that is the same turned by 180 degrees; a
round corridor with equal niches, one every metre or so; and a loop of 100 m of corridors with
equal alcoves. The laser is short-sighted and the wheels slip so much that the next niche often
lies within the filter's gate: that is counted, too.
Prints how many loops between different places were found, tempted (lay within the chi-square
gate) and were believed, how many right ones were not believed, and how many robots were lost at
the end. Asserts nothing.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
import sys
from typing import NamedTuple

from benchmarks.tables import Table
import numpy as np
from somfusion_ros.geometry import apply, Array, between, compose, squared_mahalanobis, wrap
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box, PLANS, polygon, wall
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import Outcome, run_trial, simulate_trial, Trial
from somfusion_ros.slam.loop_trust import Loop
from somfusion_ros.slam.loops import TUNING
from somfusion_ros.slam.slam import Slam

FALSE = (0.5, 0.2)             # [m] [rad] by which a loop that joins different places is wrong
AROUND = 3                     # views on each side that show where a view's place is
SPARSE = Laser(beams=257, period=0.4, range_max=6.0)
WHEEL_ERROR = 0.06             # share by which the odometry's wheels are wrong
SPEED, DURATION = 0.6, 160.0   # [m/s] [s] of a drive


class World(NamedTuple):
    """Walls (S, 4), route (K, 2) [m], slip [m] after one metre, and speed [m/s]."""

    walls: Array
    route: Array
    slip: float
    speed: float = SPEED


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
    return World(np.concatenate(parts), np.array(visited), 0.03 if furnished else 0.1)


def half_turn(rng: np.random.Generator) -> World:
    """Build what looks the same turned by 180 degrees."""
    plan = PLANS['symmetric']()
    return World(plan.segments, plan.route(int(rng.integers(2))), 0.06)


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
    return World(np.concatenate(parts), radius * np.column_stack([np.cos(way), np.sin(way)]), 0.1)


def long_loop(rng: np.random.Generator) -> World:
    """
    Build corridors around a block, with equal alcoves and a cupboard here and there.

    Where they close, after 100 m and more, the filter is unsure by metres: more than from one
    alcove to the next.
    """
    w, step, size = rng.uniform(0.8, 1.2), rng.uniform(2.0, 4.0), rng.uniform(24.0, 30.0)
    low, high = -w, size + w
    parts = [polygon([(low, low), (high, low), (high, high), (low, high)])]
    alcoves = np.arange(2.0, size - 2.0, step)
    inner = [wall((w, w), (size - w, w), [(x, 1.0) for x in alcoves])]
    inner += [polygon([(x - 0.5, w), (x - 0.5, w + 0.4), (x + 0.5, w + 0.4), (x + 0.5, w)])[:3]
              for x in alcoves]
    corners = np.array([(0.0, 0.0), (size, 0.0), (size, size), (0.0, size)])
    for corner, turn in zip(corners, 0.5 * np.pi * np.arange(4), strict=True):
        boxes = [box(x, rng.choice([-1.0, 1.0]) * (w - 0.15), rng.uniform(0.3, 1.2), 0.3)
                 for x in np.cumsum(rng.uniform(2.0, 8.0, 12)) if x < size - 2.0]
        side = np.concatenate([*inner, *boxes]).reshape(-1, 2)
        parts.append(apply(np.array([*corner, turn]), side).reshape(-1, 4))
    start = rng.uniform(0.2, 0.6) * size
    route = [(start, 0.0), *corners[1:], *corners[:2]]
    return World(np.concatenate(parts), np.array(route), 0.03, 1.0)


KINDS: dict[str, Callable[[np.random.Generator], World]] = {
    'rooms nearly alike': lambda rng: rooms(rng, True),
    'equal rooms': lambda rng: rooms(rng, False),
    'half turn': half_turn, 'niches': niches, 'long loop': long_loop}


class Witness:
    """Sits between matching and belief, and notes every loop that was found and believed."""

    def __init__(self, slam: Slam, trial: Trial) -> None:
        self._slam, self._trial, self._trusted = slam, trial, slam._map.closer.closure.trusted
        self.counts: Counter[str] = Counter()
        slam._map.closer.closure.trusted = self

    def __call__(self, loop: Loop, ekf: object) -> list:
        """Count, then believe what the SLAM believes."""
        truth = self._truth(loop.constraint)
        self.counts[f'found {truth}'] += 1
        self.counts[f'tempted {truth}'] += (
            squared_mahalanobis(*ekf.innovation(loop.constraint)) < TUNING.chi2)
        believed = self._trusted(loop, ekf)
        self.counts.update(f'believed {self._truth(constraint)}' for constraint in believed)
        return believed

    def _truth(self, constraint: object) -> str:
        old, new = (self._place(k) for k in (constraint.first, constraint.second))
        error = constraint.z - between(old, new)
        error[2] = wrap(error[2])
        # To the match, not only guessed.
        known = squared_mahalanobis(error, constraint.R) > TUNING.chi2
        far = np.hypot(*error[:2]) > FALSE[0] or abs(error[2]) > FALSE[1]
        return 'false' if known and far else 'true'

    def _place(self, k: int) -> Array:
        """
        Give the true pose (3,) of what was matched at view k, as its neighbours place it.

        A single view may be off among them, as its scan was bent by a slip: a match is of all.
        """
        memory = self._slam._map.graph            # its lock is held here
        near = np.arange(max(0, k - AROUND), min(memory.ekf.n, k + AROUND + 1))
        poses = compose(self._trial.truth(np.array(memory.stamps)[near]),
                        between(memory.ekf.poses[near], memory.ekf.poses[k]))
        turn = wrap(poses[:, 2] - poses[0, 2])
        return np.array([*np.median(poses[:, :2], axis=0), poses[0, 2] + np.median(turn)])


def look_alike_trial(number: int) -> tuple[str, Counter[str], Outcome]:
    """Drive among places that look alike; give the kind, what happened to loops, and the rest."""
    rng, kind = np.random.default_rng(number), list(KINDS)[number % len(KINDS)]
    walls, route, slip, speed = KINDS[kind](rng)
    route = route + rng.uniform(-0.05, 0.05, route.shape)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = drive.follow(route, heading, speed, DURATION)
    trial = simulate_trial(lambda t: Scene(walls), stamps, poses, SPARSE, rng,
                           drive.real_wheels(WHEEL_ERROR, rng), slip)
    trial = replace(trial, slip=[None] * len(trial.slip))     # odometry of an unknown kind
    slam = Slam()
    counts = Witness(slam, trial).counts
    return kind, counts, run_trial(trial, slam=slam)


def look_alikes_table(runs: int, first: int = 0) -> Table:
    """Return how loops among look-alike places fared, by kind of world."""
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in (*KINDS, 'all')}
    worst: dict[str, list[float]] = {kind: [] for kind in counts}
    for number in range(first, first + runs):
        kind, found, outcome = look_alike_trial(number)
        for name in (kind, 'all'):
            counts[name].update(found)
            counts[name]['lost'] += bool(outcome.slam.lost)
            worst[name].append(float(outcome.distance.max()))
    table = Table('look-alikes', (
        'world', 'runs', 'false loops found', 'tempting', 'believed', 'true loops found',
        'not believed', 'lost at the end', 'largest error, median [m]', '95 % [m]'),
        (*[None] * 8, 2, 2))
    return table.extend(
        (name, len(worst[name]), c['found false'], c['tempted false'], c['believed false'],
         c['found true'], c['found true'] - c['believed true'], c['lost'],
         float(np.median(worst[name])), float(np.percentile(worst[name], 95)))
        for name, c in counts.items() if worst[name])


def main() -> None:
    """Print the table."""
    words = [int(word) for word in sys.argv[1:]]
    print(look_alikes_table(*(words or [200])).markdown())


if __name__ == '__main__':
    main()
