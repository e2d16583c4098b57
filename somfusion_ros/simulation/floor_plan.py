# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Floor plans for the simulation: walls and furniture as line segments, and the robots' routes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import apply, Array, Pose

WALL = 0.12   # [m] thickness of an inner wall


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """
    A place to drive in.

    segments (S, 4) x0, y0, x1, y1 [m] of everything that a laser sees, size [m], and routes:
    way points (K, 2) [m] per robot, the first is where it starts; duration [s] allowed for them.
    """

    segments: Array
    size: tuple[float, float]
    routes: tuple[Array, ...]
    duration: float = 75.0

    def route(self, robot: int) -> Array:
        """Return way points (K, 2) of a robot; more robots than routes run them backwards."""
        way = self.routes[robot % len(self.routes)]
        return way if (robot // len(self.routes)) % 2 == 0 else way[::-1]


def polygon(corners: ArrayLike) -> Array:
    """Return the segments (N, 4) of a closed polygon."""
    points = np.asarray(corners, dtype=float)
    return np.column_stack([points, np.roll(points, -1, 0)])


def box(x: float, y: float, width: float, depth: float, turned: float = 0.0) -> Array:
    """Return the segments (4, 4) of a box around (x, y) [m], turned [deg]."""
    half = 0.5 * np.array([(-width, -depth), (width, -depth), (width, depth), (-width, depth)])
    return polygon(apply(Pose(x, y, float(np.radians(turned))), half))


def pillar(x: float, y: float, radius: float) -> Array:
    """Return the segments (12, 4) of a round pillar."""
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    return polygon(np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)]))


def wall(start: Sequence[float], end: Sequence[float],
         doors: Sequence[tuple[float, float]] = ()) -> Array:
    """Return the segments of a wall along x or y; doors are (middle, width) [m] on that axis."""
    along = 0 if start[1] == end[1] else 1
    edges = [start[along]]
    for middle, width in sorted(doors):
        edges += [middle - 0.5 * width, middle + 0.5 * width]
    edges.append(end[along])
    pieces = []
    for a, b in zip(edges[::2], edges[1::2]):
        middle, length = 0.5 * (a + b), b - a
        pieces.append(box(middle, start[1], length, WALL) if along == 0
                      else box(start[0], middle, WALL, length))
    return np.concatenate(pieces)


def office() -> FloorPlan:
    """Make seven rooms on both sides of a corridor, 17 x 10 m."""
    parts = [
        polygon([(0, 0), (17, 0), (17, 10), (0, 10)]),
        wall((0, 6), (17, 6), [(2.6, 1.0), (5.4, 1.0), (11.3, 1.1), (14.2, 1.0)]),
        wall((0, 4.4), (17, 4.4), [(4.4, 1.0), (7.4, 1.2), (13.1, 1.0)]),
        wall((4.2, 6), (4.2, 10)), wall((8, 6), (8, 10), [(8.6, 1.0)]), wall((13, 6), (13, 10)),
        wall((5.8, 0), (5.8, 4.4), [(1.6, 1.0)]), wall((11.2, 0), (11.2, 4.4)),
        box(0.9, 9.5, 1.6, 0.8), box(3.85, 8.2, 0.5, 1.4),
        box(6.6, 7.3, 1.2, 0.7, 20.0), box(10.5, 9.75, 3.0, 0.4), box(9.0, 6.6, 1.4, 0.7),
        pillar(12.0, 8.2, 0.2), box(16.4, 9.0, 0.8, 1.6), box(15.9, 6.5, 1.4, 0.7),
        pillar(1.5, 2.0, 0.5), box(0.3, 3.2, 0.5, 1.2), box(3.4, 0.4, 1.8, 0.7),
        box(6.9, 0.4, 1.6, 0.6), box(10.4, 2.6, 0.9, 0.8, 10.0), box(15.0, 1.5, 2.0, 0.9, 30.0),
        box(16.7, 3.3, 0.5, 1.4), box(9.4, 4.65, 0.4, 0.3), box(16.2, 5.75, 1.0, 0.35),
    ]
    routes = (
        [(2.0, 7.8), (2.6, 6.8), (2.6, 5.2), (4.4, 5.2), (4.4, 3.6), (3.0, 2.9), (3.6, 1.7),
         (5.0, 1.6), (6.6, 1.6), (8.4, 1.8), (9.0, 3.0), (7.4, 3.6), (7.4, 5.2), (5.4, 5.2),
         (5.4, 6.9), (5.3, 8.7), (7.0, 8.7), (8.8, 8.5), (10.4, 8.2), (11.3, 7.0), (11.3, 5.3)],
        [(15.0, 3.4), (13.1, 3.5), (13.1, 5.2), (14.2, 5.3), (14.2, 6.8), (14.6, 8.3),
         (14.2, 6.8), (14.0, 5.3), (11.3, 5.3), (11.3, 6.8), (10.6, 7.9), (9.0, 8.6),
         (7.0, 8.7), (5.4, 8.3), (5.4, 6.9), (5.4, 5.2), (7.4, 5.2), (7.4, 3.6), (8.4, 2.2)],
        [(2.4, 3.6), (4.4, 3.5), (4.4, 5.2), (7.4, 5.3), (11.3, 5.3), (13.1, 5.2), (13.1, 3.5),
         (13.0, 1.5), (13.1, 3.5), (13.1, 5.2), (11.3, 5.3), (11.3, 6.9), (10.6, 8.0)],
        [(14.6, 8.4), (14.2, 6.8), (14.0, 5.3), (11.3, 5.3), (7.4, 5.2), (7.4, 3.5), (8.6, 2.0),
         (7.4, 3.5), (7.4, 5.2), (2.6, 5.2), (2.6, 6.8), (2.0, 8.0)])
    return _plan(parts, (17.0, 10.0), routes)


def corridor() -> FloorPlan:
    """Make a corridor of 26 m with twelve rooms that are nearly alike: strong aliasing."""
    doors = [(2.2 + 4.3 * k, 0.9) for k in range(6)]
    parts = [polygon([(0, 0), (26, 0), (26, 9.0), (0, 9.0)]),
             wall((0, 3.6), (26, 3.6), doors), wall((0, 5.4), (26, 5.4), doors)]
    for k in range(1, 6):
        parts += [wall((4.3 * k, 0), (4.3 * k, 3.6)), wall((4.3 * k, 5.4), (4.3 * k, 9.0))]
    parts += [box(0.9 + 4.3 * k, 0.5, 1.4, 0.7) for k in range(6)]
    parts += [box(3.3 + 4.3 * k, 8.5, 1.4, 0.7) for k in range(6) if k != 3]
    parts += [pillar(11.7, 2.2, 0.3), box(18.6, 5.2, 0.9, 0.3), box(7.3, 3.8, 0.4, 0.3)]
    left = _visits([2.2, 6.5, 10.8, 15.1], (3.6, 5.4))
    right = _visits([23.7, 19.4, 15.1, 10.8], (5.4, 3.6))
    return _plan(parts, (26.0, 9.0), (left, right))


def symmetric() -> FloorPlan:
    """
    Make two halves that are alike when turned by 180 degrees.

    Both robots see both halves, so that the true pose and its opposite fit equally well: a merge
    must be refused as ambiguous.
    """
    half = [wall((8.5, 0), (8.5, 3.9)), wall((0, 3.9), (8.5, 3.9), [(2.0, 1.0), (6.4, 1.0)]),
            wall((4.2, 0), (4.2, 3.9)), wall((0, 6.1), (8.5, 6.1), [(3.0, 1.1)]),
            box(0.9, 0.6, 1.5, 0.8), box(6.9, 0.5, 2.0, 0.6), pillar(5.9, 8.4, 0.3),
            box(1.2, 9.5, 1.8, 0.7, 15.0), box(4.4, 5.85, 0.8, 0.35)]
    parts = [polygon([(0, 0), (17, 0), (17, 10), (0, 10)])]
    for piece in half:
        turned = (17.0, 10.0, 17.0, 10.0) - piece
        parts += [piece, turned]
    left = [(2.0, 2.6), (2.0, 5.0), (3.0, 5.0), (3.0, 7.2), (2.4, 8.4), (3.0, 7.2), (3.0, 5.0),
            (6.4, 5.0), (6.4, 2.4), (6.4, 5.0), (7.8, 5.0)]
    right = [(17.0 - x, 10.0 - y) for x, y in left]
    return _plan(parts, (17.0, 10.0), (left + right[::-1], right + left[::-1]), 115.0)


def loop() -> FloorPlan:
    """Make a ring corridor around a block, for loop closures."""
    parts = [polygon([(0, 0), (17, 0), (17, 10), (0, 10)]),
             polygon([(2.0, 2.0), (7.0, 2.0), (7.0, 3.0), (9.0, 3.0), (9.0, 2.0), (15.0, 2.0),
                      (15.0, 5.5), (14.2, 5.5), (14.2, 7.0), (15.0, 7.0), (15.0, 8.2),
                      (5.0, 8.2), (5.0, 7.4), (3.6, 7.4), (3.6, 8.2), (2.0, 8.2)]),
             box(5.2, 0.2, 1.0, 0.4), box(12.4, 9.7, 1.6, 0.5), box(0.25, 6.0, 0.5, 0.9),
             pillar(16.7, 3.4, 0.25), box(11.0, 0.15, 0.6, 0.3), box(8.0, 9.85, 0.8, 0.3)]
    ring = np.array([(1.0, 1.0), (4.5, 1.1), (9.0, 1.0), (13.0, 1.0), (15.9, 1.0), (16.0, 4.9),
                     (16.0, 9.0), (12.0, 8.9), (6.0, 9.1), (1.0, 9.0), (1.1, 5.0)])
    return _plan(parts, (17.0, 10.0), (np.concatenate([ring, ring[:3]]),
                                       np.concatenate([ring[6::-1], ring[:6:-1], ring[6:4:-1]])),
                 duration=140.0)


PLANS = {'office': office, 'corridor': corridor, 'symmetric': symmetric, 'loop': loop}


def _visits(rooms: Sequence[float], sides: tuple[float, float]) -> list[tuple[float, float]]:
    """Return way points of a corridor drive that looks into rooms at x, on alternating sides."""
    points = []
    for number, x in enumerate(rooms):
        side = sides[number % 2]
        inside = side - 1.6 if side < 4.5 else side + 1.6
        points += [(x, 4.5), (x, inside), (x, 4.5)]
    return points[1:]


def _plan(parts: Sequence[Array], size: tuple[float, float],
          routes: Sequence[ArrayLike], duration: float = 75.0) -> FloorPlan:
    """Put a plan together."""
    return FloorPlan(np.concatenate(parts), size,
                     tuple(np.asarray(route, dtype=float) for route in routes), duration)
