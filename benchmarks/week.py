# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how a map follows what changes: an office in which furniture is moved night after night.

usage: python -m benchmarks.week [DAYS [SEED]]      default 7 1

Every day a robot drives from room to room for a quarter of an hour; at night it is switched off,
and half of the furniture is moved. Prints a row per day: share of the walls drawn that stand; of
the outline of the furniture that stands, which is drawn (the sides that are never seen are not);
of the outline of what was moved away, which is cleared; median and largest error [m] of the
pose told; views. Asserts nothing.
"""

from dataclasses import replace
import sys

from benchmarks.data.errands import CORRIDOR, office, ROOMS, World
from benchmarks.life import Life, TURNS
import numpy as np
from scipy.spatial import cKDTree
from somfusion_ros.geometry import Array, between
from somfusion_ros.simulation import drive, floor_plan
from somfusion_ros.slam.slam import Slam

NEAR = 0.1        # [m] from what stands to what is drawn
CLEAR = 1.0       # [m] from a way to the middle of a piece of furniture
PIECES = 12
# x0, y0, x1, y1 [m] of the rooms in which furniture is moved.
INSIDE = np.array([(0.4, 6.4, 3.8, 9.6), (4.6, 6.4, 7.6, 9.6), (8.4, 6.4, 12.6, 9.6),
                   (13.4, 6.4, 16.6, 9.6), (0.4, 0.4, 5.4, 4.0), (6.2, 0.4, 10.8, 4.0),
                   (11.6, 0.4, 16.6, 4.0)])


def outline(segments: Array, step: float = 0.05) -> Array:
    """Return points (N, 2) along segments (S, 4)."""
    parts = [a[:2] + np.linspace(0.0, 1.0, max(2, int(np.hypot(*(a[2:] - a[:2])) / step)))[:, None]
             * (a[2:] - a[:2]) for a in segments]
    return np.concatenate(parts)


def piece(rng: np.random.Generator, ways: Array) -> Array:
    """Return a box (4, 4) somewhere in a room, off the ways (N, 2)."""
    while True:
        x0, y0, x1, y1 = INSIDE[rng.integers(len(INSIDE))]
        middle = rng.uniform((x0, y0), (x1, y1))
        if np.hypot(*(ways - middle).T).min() > CLEAR:
            return floor_plan.box(*middle, *rng.uniform(0.4, 0.8, 2), float(rng.uniform(0, 90)))


class Week(Life):
    """A robot in an office whose furniture is moved."""

    def __init__(self, rng: np.random.Generator, world: World | None = None,
                 pieces: int = PIECES) -> None:
        super().__init__(world or office(), rng)
        self._walls = self.world.segments
        self._driven = outline(np.array([way for door, x, y in ROOMS for way in (
            (door, CORRIDOR, door, y), (door, y, x, y))]))
        self._pieces = [piece(rng, self._driven) for _ in range(pieces)]
        self._moved: list[Array] = []
        self._stand()

    def _stand(self) -> None:
        self.world = replace(
            self.world, segments=np.concatenate([self._walls, *self._pieces]), _near={})

    def night(self) -> None:
        """Switch the robot off and on, and move half of the furniture meanwhile."""
        self.slam = Slam(background=True, checkpoint=self.slam.checkpoint())
        self.move(len(self._pieces) // 2)

    def move(self, pieces: int) -> None:
        """Move so many pieces of furniture."""
        moving = self._rng.choice(len(self._pieces), pieces, replace=False)
        self._moved = [self._pieces[k] for k in moving]
        for k in moving:
            self._pieces[k] = piece(self._rng, self._driven)
        self._stand()

    def somewhere(self, rng: np.random.Generator, metres: float) -> tuple[Array, Array]:
        """Return stamps (T,) [s] and poses (T, 3) of a way that begins somewhere on the others."""
        ways = self.world.ways(rng)
        points = [next(ways) for _ in range(int(rng.integers(5, 40)))][-2:]
        points[0] = points[0] + rng.uniform() * (points[1] - points[0])
        points += [next(ways) for _ in range(int(metres))]
        return drive.follow(np.array(points), float(rng.uniform(-np.pi, np.pi)),
                            self.world.speed, metres / (TURNS * self.world.speed))

    def right(self) -> tuple[float, float, float]:
        """Return the shares of walls drawn that stand, of what stands drawn, of what went."""
        grid = self.slam.grid()
        drawn = cKDTree(grid.points(grid.occupied))
        standing = self._seen_from_start(outline(self.world.segments))
        furniture = self._seen_from_start(outline(np.concatenate(self._pieces)))
        stands = cKDTree(standing).query(drawn.data)[0] < NEAR
        found = drawn.query(furniture)[0] < NEAR
        if not self._moved:
            return float(stands.mean()), float(found.mean()), 1.0
        gone = self._seen_from_start(outline(np.concatenate(self._moved)))
        gone = gone[cKDTree(standing).query(gone)[0] > 2.0 * NEAR]
        cleared = drawn.query(gone)[0] > NEAR
        return float(stands.mean()), float(found.mean()), float(cleared.mean())

    def _seen_from_start(self, points: Array) -> Array:
        """Return points (N, 2) in the map's frame, where the robot began."""
        return between(self.first, np.column_stack([points, np.zeros(len(points))]))[:, :2]


def main() -> None:
    """Print a row per day."""
    days = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    week = Week(np.random.default_rng(seed))
    print(' day  walls right  furniture drawn  removed cleared   error  largest  views')
    for day in range(1, days + 1):
        told = week.live(0.25)
        right, found, cleared = week.right()
        print(f'{day:4} {right:12.3f} {found:16.3f} {cleared:16.3f} '
              f'{np.median(told.error):7.3f} {max(told.error):8.3f} '
              f'{sum(len(cloud) > 0 for cloud in week.slam.checkpoint().clouds):6}', flush=True)
        week.night()


if __name__ == '__main__':
    main()
