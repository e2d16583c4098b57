# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how the team's elastic map grows with robots and views, from bytes to the drawn map.

usage: python -m benchmarks.team.joint_growth [ROBOTS VIEWS]...

Every robot wanders through one building of rooms of 8 x 5 m, with a laser of 181 beams, and is
tied to the four after it by 60 matches at random places: the worst case for the sparsity, since
matches of real teams lie where the robots were together. All is one robot's work: it reads what
all others tell, solves, and draws; then once more with ten more views of each.
"""

from collections.abc import Iterator, Mapping
import gc
import sys
import time
from typing import cast

from benchmarks.memory import held_bytes
import numpy as np
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.slam.tracker_state import TrackerState
from somfusion_ros.team.joint import solve_joint
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.teller import Teller
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.view_store import encode_batches, ViewStore

TEAMS = ((2, 400), (4, 400), (8, 1000), (20, 400), (50, 400))    # robots, views of each
NEIGHBOURS, MATCHES, MORE = 4, 60, 10
STEP = np.array([0.02, 0.01, 0.005])    # [m] [m] [rad] sigma of a step between views
ROOM = np.array([8.0, 5.0])             # [m]
BEAMS, NOISE = np.linspace(-np.pi / 2, np.pi / 2, 181), 0.01     # [rad] [m]
RESOLUTION = 0.05                       # [m]
NOT_USED = cast(TrackerState, None)     # of a checkpoint by what is told
EPOCH = Epoch('a1')


def seen(pose: Array, rng: np.random.Generator) -> Cloud:
    """Scan the walls of the room that a robot is in."""
    direction = np.column_stack([np.cos(pose[2] + BEAMS), np.sin(pose[2] + BEAMS)])
    inside = pose[:2] % ROOM
    wall = np.where(direction > 0.0, ROOM - inside, -inside)
    with np.errstate(divide='ignore', invalid='ignore'):
        ranges = np.nanmin(np.where(direction == 0.0, np.inf, wall / direction), axis=1)
    ranges = np.maximum(ranges + NOISE * rng.normal(size=len(ranges)), 0.05)
    return cloud(Scan(0.0, ranges, BEAMS[0], BEAMS[1] - BEAMS[0], 0.01, 30.0,
                      T_base_laser=Pose()), 30.0)


def robot(views: int, seed: int) -> tuple[Checkpoint, Array]:
    """Make a robot that wanders, with a loop per four views; and its true poses (n, 3)."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.uniform(-0.3, 0.3, views))
    truth = np.column_stack([np.cumsum(0.4 * np.cos(heading)), np.cumsum(0.4 * np.sin(heading)),
                             heading])
    made: list[Constraint] = []
    for k in range(views):
        if k:
            made.append(Constraint(k - 1, k, between(truth[k - 1], truth[k])
                                   + STEP * rng.normal(size=3), np.diag(STEP) ** 2))
        if k >= 40 and k % 4 == 0:
            made.append(Constraint(k - 40, k, between(truth[k - 40], truth[k])
                                   + 0.01 * rng.normal(size=3), 1e-4 * np.eye(3)))
    clouds = [seen(pose, rng) for pose in truth]
    return Checkpoint(truth, np.arange(views) * 1.0, clouds, made, (), np.zeros((0, 5)), (), 0,
                      NOT_USED, EPOCH), truth


def batches(path: Checkpoint) -> tuple[list[bytes], list[bytes]]:
    """Return what a robot tells of a path, without and of the last views."""
    teller, n = Teller(), len(path.poses) - MORE
    before = Checkpoint(path.poses[:n], path.stamps[:n], path.clouds[:n],
                        [c for c in path.constraints if c.second < n], (), path.trail, (), 0,
                        path.tracker, EPOCH)
    return (encode_batches(EPOCH, 't', teller.more(before)),
            encode_batches(EPOCH, 't', teller.more(path)))


def matches_of(truth: dict[str, Array]) -> Iterator[InterMatch]:
    """Match every robot with those after it."""
    rng, names = np.random.default_rng(0), sorted(truth)
    for index, one in enumerate(names):
        for other in names[index + 1:index + 1 + NEIGHBOURS]:
            for view in rng.integers(0, len(truth[one]), MATCHES).tolist():
                z = between(truth[one][view], truth[other][view]) + 0.01 * rng.normal(size=3)
                yield InterMatch(one, view, other, view, z, 1e-4 * np.eye(3))


def memory() -> float:
    """Return the memory [MB] that the process holds."""
    gc.collect()
    return held_bytes() / 1e6


class Stopwatch:
    """CPU time [s] since it was asked last."""

    def __init__(self) -> None:
        self._at = time.process_time()

    def __call__(self) -> float:
        """Return it."""
        before, self._at = self._at, time.process_time()
        return self._at - before


def row(robots: int, views: int) -> list[str]:
    """Measure one team; return its cells."""
    truth: dict[str, Array] = {}
    told: dict[str, tuple[list[bytes], list[bytes]]] = {}
    for k in range(robots):
        path, truth[f'robot{k:02d}'] = robot(views, k)
        told[f'robot{k:02d}'] = batches(path)
    found, maps = list(matches_of(truth)), dict.fromkeys(told, np.zeros(3))
    before = [m for m in found if max(m.target_view, m.source_view) < views - MORE]
    size = sum(len(part) for both in told.values() for some in both for part in some)
    empty, stores, cells = memory(), {name: ViewStore() for name in told}, []
    start: Mapping[str, Array] | None = None
    mapper = Mapper(RESOLUTION)
    for when, matches in ((0, before), (1, found)):
        clock = Stopwatch()
        for name, both in told.items():
            for part in both[when]:
                stores[name].take(part)
        team: dict[str, ViewSet] = {name: store.views() for name, store in stores.items()}
        read = clock()
        start = solve_joint(team, matches, maps, start=start).poses
        solved = clock()
        draw_joint(team, start, RESOLUTION, mapper=mapper)
        cells.append(f'{read:.1f}, {solved:.2f}, {clock():.1f} s')
    clock = Stopwatch()
    whole = solve_joint(team, found, maps).poses
    cells.append(f'{clock():.2f} s')
    off = max(float(np.hypot(*(start[name] - whole[name])[:, :2].T).max()) for name in team)
    return [f'{robots} x {views}', str(len(found)), f'{size / 1e3:.0f} kB', *cells,
            f'{1e3 * off:.0f} mm', f'{memory() - empty:.0f} MB']


def main() -> None:
    """Print a row per team."""
    given = [int(word) for word in sys.argv[1:]]
    print('| robots and views | matches | told | read, solved, drawn | ten more views of each | '
          'all solved anew | off by that at most | memory for that |')
    print('|---' * 8 + '|')
    for robots, views in list(zip(given[::2], given[1::2], strict=True)) or TEAMS:
        print(f'| {" | ".join(row(robots, views))} |', flush=True)


if __name__ == '__main__':
    main()
