# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how the team's sparse problem grows with robots and views.

usage: python -m benchmarks.team.joint_growth

Every robot is tied to the four after it by 60 matches at random places: the worst case for the
sparsity, since matches of real teams lie where the robots were together.
"""

from collections.abc import Iterator
import resource
import time

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.team.joint import solve_joint
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_set import ViewSet

TEAMS = ((2, 400), (4, 400), (8, 1000), (20, 400), (50, 400))    # robots, views of each
NEIGHBOURS, MATCHES, MORE = 4, 60, 10
STEP = np.array([0.02, 0.01, 0.005])    # [m] [m] [rad] sigma of a step between views
NOTHING = Cloud(np.zeros((0, 2)), np.zeros((0, 2)))


def robot(views: int, seed: int) -> tuple[ViewSet, Array]:
    """Make a robot that wanders, with a loop per four views; and its true poses (n, 3)."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.uniform(-0.3, 0.3, views))
    truth = np.column_stack([np.cumsum(0.4 * np.cos(heading)), np.cumsum(0.4 * np.sin(heading)),
                             heading])
    steps = [Constraint(k, k + 1, between(truth[k], truth[k + 1]) + STEP * rng.normal(size=3),
                        np.diag(STEP) ** 2) for k in range(views - 1)]
    loops = [Constraint(k, k + 40, between(truth[k], truth[k + 40]) + 0.01 * rng.normal(size=3),
                        1e-4 * np.eye(3)) for k in range(0, views - 41, 4)]
    return ViewSet(np.arange(views) * 1.0, truth, [NOTHING] * views, steps, loops), truth


def matches_of(truth: dict[str, Array]) -> Iterator[InterMatch]:
    """Match every robot with those after it."""
    rng, names = np.random.default_rng(0), sorted(truth)
    for index, one in enumerate(names):
        for other in names[index + 1:index + 1 + NEIGHBOURS]:
            for view in rng.integers(0, len(truth[one]), MATCHES).tolist():
                z = between(truth[one][view], truth[other][view]) + 0.01 * rng.normal(size=3)
                yield InterMatch(one, view, other, view, z, 1e-4 * np.eye(3))


def main() -> None:
    """Print a row per team: the whole, and ten more views of every robot."""
    print('| robots and views | matches | CPU | with ten more views each | moved by that at most '
          '| memory of the process |\n|---|---|---|---|---|---|')
    for robots, views in TEAMS:
        team = {f'robot{k:02d}': robot(views, k) for k in range(robots)}
        found = list(matches_of({name: truth for name, (_, truth) in team.items()}))
        maps = dict.fromkeys(team, np.zeros(3))
        before = [m for m in found if max(m.target_view, m.source_view) < views - MORE]
        start = solve_joint({name: shortened(one) for name, (one, _) in team.items()}, before,
                            maps).poses
        whole = {name: one for name, (one, _) in team.items()}
        begun = time.process_time()
        solved = solve_joint(whole, found, maps).poses
        took = time.process_time() - begun
        begun = time.process_time()
        warm = solve_joint(whole, found, maps, start=start).poses
        more = time.process_time() - begun
        off = max(float(np.hypot(*(warm[name] - solved[name])[:, :2].T).max()) for name in team)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f'| {robots} x {views} | {len(found)} | {took:.2f} s | {more:.2f} s | {off:.3f} m | '
              f'{memory:.0f} MB |', flush=True)


def shortened(views: ViewSet) -> ViewSet:
    """Return what a robot knew ten views ago."""
    n = len(views) - MORE
    return ViewSet(views.stamps[:n], views.poses[:n], views.clouds[:n], views.steps[:n - 1],
                   [loop for loop in views.loops if max(loop.first, loop.second) < n])


if __name__ == '__main__':
    main()
