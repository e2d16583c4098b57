# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds in which a robot drives for hours, from one errand to the next."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.simulation import floor_plan
from somfusion_ros.simulation.laser import Scene

CORRIDOR = 5.2   # [m] y of the office's corridor
# x [m] of the door of each of the office's seven rooms, and a point in its middle.
ROOMS = [(2.6, 2.0, 8.0), (5.4, 6.0, 8.0), (11.3, 10.5, 8.0), (14.2, 15.0, 8.0),
         (4.4, 3.0, 2.5), (7.4, 8.0, 2.5), (13.1, 13.0, 2.5)]
# [m] by which a way passes beside door, inside, middle, inside, door at most: no two are alike.
ASIDE = np.array([(0.15, 0.15), (0.15, 0.3), (0.3, 0.3), (0.15, 0.3), (0.15, 0.15)])
BLOCK = 50.0     # [m] from street to street
STREETS = 11     # each way, so that the town is 500 m wide
WIDTH = 8.0      # [m] of a street
SEES = 35.0      # [m] around the robot, beyond which nothing is simulated
Ways = Callable[[np.random.Generator], Iterator[Array]]


@dataclass(frozen=True, eq=False)
class World:
    """
    Where a robot drives: segments (S, 4) [m], how fast [m/s], and the edge [m] of its map's cells.

    ways(rng) yields way points (2,) [m] without end; the robot starts at the first.
    """

    segments: Array
    speed: float
    ways: Ways
    resolution: float = 0.05
    _near: dict[tuple[int, int], Scene] = field(default_factory=dict)

    def around(self, pose: Array) -> Scene:
        """Return what can be seen from a pose (3,)."""
        x, y = (int(side) for side in pose[:2] // 10.0)
        if (x, y) not in self._near:
            low = np.minimum(self.segments[:, :2], self.segments[:, 2:]) - SEES
            high = np.maximum(self.segments[:, :2], self.segments[:, 2:]) + SEES
            here = np.array([10.0 * x, 10.0 * y])
            near = ((low < here + 10.0) & (high > here)).all(1)
            self._near[x, y] = Scene(self.segments[near])
        return self._near[x, y]


def office(segments: Array | None = None) -> World:
    """Make an office of seven rooms that are visited alike; segments: as it is furnished."""
    return _rooms(np.full(len(ROOMS), 1.0 / len(ROOMS)), segments)


def rooms() -> World:
    """Make the same office, where five rooms are visited, one of them once in a hundred times."""
    return _rooms(np.array([0.25, 0.25, 0.25, 0.24, 0.01, 0.0, 0.0]), None)


def _rooms(share: Array, segments: Array | None) -> World:
    def ways(rng: np.random.Generator) -> Iterator[Array]:
        yield np.array([2.0, CORRIDOR])
        while True:
            door, x, y = ROOMS[rng.choice(len(share), p=share)]
            way = np.array([(door, CORRIDOR), (door, y), (x, y), (door, y), (door, CORRIDOR)])
            yield from way + rng.uniform(-ASIDE, ASIDE)

    return World(floor_plan.office().segments if segments is None else segments, 0.4, ways)


def town() -> World:
    """Make a town of 500 x 500 m: straight streets between blocks with bays and pillars."""
    rng = np.random.default_rng(500)
    parts = [_block(BLOCK * np.array([i, j]), rng)
             for i in range(-1, STREETS) for j in range(-1, STREETS)]
    return World(np.concatenate(parts), 1.0, _streets, 0.1)


def _block(corner: Array, rng: np.random.Generator) -> Array:
    """Return the segments (S, 4) of a block between the streets from a crossing up and right."""
    half, middle = 0.5 * (BLOCK - WIDTH), corner + 0.5 * BLOCK
    parts = [floor_plan.box(*middle, 2.0 * half, 2.0 * half)]
    for side in range(4):
        along, out = np.roll([1.0, 0.0], side), np.roll([0.0, 1.0], side) * (-1) ** (side // 2)
        for _ in range(8):
            x, y = middle + rng.uniform(-half, half) * along + half * out
            parts.append(floor_plan.box(x, y, *rng.uniform(0.3, 2.4, 2), rng.choice([0.0, 15.0])))
    return np.concatenate(parts)


def _streets(rng: np.random.Generator) -> Iterator[Array]:
    """Yield crossings, each beside the last; of the streets from one, the least driven."""
    here, driven = (0, 0), Counter[frozenset[tuple[int, int]]]()
    while True:
        yield BLOCK * np.array(here, float)
        beside = [(here[0] + i, here[1] + j) for i, j in ((1, 0), (0, 1), (-1, 0), (0, -1))
                  if 0 <= here[0] + i < STREETS and 0 <= here[1] + j < STREETS]
        there = min(beside, key=lambda p: (driven[frozenset((here, p))], rng.random()))
        driven[frozenset((here, there))] += 1
        here = there


WORLDS: dict[str, Callable[[], World]] = {'office': office, 'rooms': rooms, 'town': town}
