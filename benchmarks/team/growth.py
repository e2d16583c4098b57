# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how one robot's share of the work grows with its team: the fusion core alone, no ROS.

usage: python -m benchmarks.team.growth [ROBOTS ...]     (default: 5 10 20 35 50)

The robots map a building of furnished rooms, each robot two of them, so that it shares a room
with the one before and the one behind. The robot in the middle hears the clusters of all others,
asks for the maps of those that may match, matches them, solves the graph of what all accepted, of
which one pair in twenty is wrong, asks for the maps of all who are connected, and draws them.
Prints one row per team and fitted exponents, asserts nothing.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import sys
import time
import tracemalloc

from benchmarks.tables import Table
from helpers import fake_grid, furnished_room
import numpy as np
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import between, Pose
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.map_codec import MapEncoder
from somfusion_ros.team.members import Team
from somfusion_ros.team.screening import outline, screen
from somfusion_ros.team.shared_map import SharedMap

ROOM, SIDE = 11.0, 7   # [m] between two rooms, rooms in a row of the building
WRONG = 0.05           # share of the accepted pairs that are wrong
ROW_BYTES = 28         # of one cluster on the wire
COUNTS = (5, 10, 20, 35, 50)   # robots of a team
COLUMNS = ('screen [s]', 'match [s]', 'solve [s]', 'draw [s]', 'clusters heard [kB]',
           'maps heard [kB]', 'memory [MB]')


def frame(number: int) -> Pose:
    """Pose of the building in the map frame of a robot."""
    return Pose(*np.random.default_rng(number).uniform((-5, -5, -3), (5, 5, 3)))


def map_of(number: int) -> SharedMap:
    """Map of a robot: the rooms of its number and of the next one."""
    walls = [room(seed).reshape(-1, 2) + place(seed) for seed in (number, number + 1)]
    return SharedMap(fake_grid(np.concatenate(walls).reshape(-1, 4), T_map_walls=frame(number)))


def room(seed: int) -> np.ndarray:
    """Walls (N, 4) of a room that is like no other."""
    return furnished_room(*np.random.default_rng(seed).uniform((7.0, 6.0), (10.5, 10.5)), seed)


def place(seed: int) -> np.ndarray:
    """Give the corner (2,) [m] of a room; the rows of the building are walked to and fro."""
    row, column = divmod(seed, SIDE)
    return ROOM * np.array([SIDE - 1 - column if row % 2 else column, row])


def accepted(count: int) -> dict[str, list[MapConstraint]]:
    """List what each robot accepted about the one behind it, by its name."""
    rng, said = np.random.default_rng(0), {}
    for number in range(count - 1):
        T = between(between(frame(number), Pose()), between(frame(number + 1), Pose()))
        if rng.random() < WRONG:
            T = T + (3.0, -2.0, 1.0)
        said[named(number)] = [MapConstraint(
            named(number), named(number + 1), Pose.from_array(T), 1e-3 * np.eye(3))]
    return said


def named(number: int) -> str:
    """Name robots so that their order is that of their numbers."""
    return f'robot{number:03}'


def measure(count: int) -> list[float]:
    """Let the robot in the middle meet a team; return the columns of the table."""
    middle = count // 2
    own = learn(map_of(middle).grid)
    team, told, sent, seconds = Team(named(middle)), 0, 0, np.zeros(4)
    team.update_map(team.name, map_of(middle))
    tracemalloc.start()
    for number in (n for n in range(count) if n != middle):
        shared = map_of(number)
        clusters = outline(learn(shared.grid))
        told += ROW_BYTES * len(clusters)
        with timed(seconds, 0):
            likely = screen(own, clusters).likely
        if likely:
            sent += fetch(team, named(number), shared)
            target, source = team.grids_of(named(number))
            with timed(seconds, 1):
                team.record(named(number), align(target, source), target, source, 0.0)
    with timed(seconds, 2):
        for owner, constraints in accepted(count).items():
            team.hear(owner, constraints)
        solution = team.solution()
    world = solution.group_of(team.name)
    for number in range(count):
        if named(number) in world and named(number) not in team.maps:
            sent += fetch(team, named(number), map_of(number))
    with timed(seconds, 3):
        merge_grids({name: shared.grid for name, shared in team.maps.items() if name in world},
                    world)
    peak = tracemalloc.get_traced_memory()[1] / 2 ** 20
    tracemalloc.stop()
    return [*seconds, told / 1e3, sent / 1e3, peak]


def fetch(team: Team, robot: str, shared: SharedMap) -> int:
    """Take in a robot's whole map; return the bytes that this costs."""
    encoder = MapEncoder()
    encoder.encode(shared.to_cells())
    team.update_map(robot, shared)
    return len(encoder.key)


@contextmanager
def timed(seconds: np.ndarray, index: int) -> Iterator[None]:
    """Add the CPU time of a block to an entry of an array."""
    begun = time.process_time()
    yield
    seconds[index] += time.process_time() - begun


def growth_table(counts: Sequence[int] = COUNTS) -> Table:
    """Return a robot's share of the work by the size of its team, with fitted exponents."""
    table = Table('team-growth', ('robots', *COLUMNS), (None, 2, 2, 2, 2, 0, 0, 0))
    rows = [measure(count) for count in counts]
    powers = [float(np.polyfit(np.log(counts), np.log(np.maximum(column, 1e-6)), 1)[0])
              for column in np.array(rows).T]
    table.extend([count, *row] for count, row in zip(counts, rows, strict=True))
    table.add('~ n^', *(f'{power:.2f}' for power in powers))
    return table


def main() -> None:
    """Print the table."""
    print(growth_table([int(word) for word in sys.argv[1:]] or COUNTS).markdown())


if __name__ == '__main__':
    main()
