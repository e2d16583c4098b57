# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps drawn from nothing: corridors, offices of equal rooms, buildings of different rooms."""

import cv2
import numpy as np
from somfusion_ros.grid import Grid

Random = np.random.Generator
CELL = 0.05


def corridor(rng: Random, width: float, length: float, crossings: int) -> Grid:
    """Draw a corridor with doors, alcoves and crossings at random places, its ends seen or not."""
    drawing = Drawing(length, 2.0 * 5.0 + width)
    middle = 5.0 + width / 2.0
    drawing.free(0.0, length, 5.0, 5.0 + width)
    start = rng.uniform(1.0, 4.0)
    while start < length - 1.5:
        depth = rng.uniform(1.0, 3.0) if rng.random() < 0.25 else rng.uniform(0.05, 0.3)
        near = 5.0 + width if rng.random() < 0.5 else 5.0 - depth
        drawing.free(start, start + rng.uniform(0.8, 1.1), near, near + depth)
        start += rng.uniform(1.2, 6.0)
    for _ in range(crossings):
        at = rng.uniform(2.0, length - 4.0)
        low, high = ((middle, 9.9 + width), (0.1, middle), (0.1, 9.9 + width))[rng.integers(3)]
        drawing.free(at, at + rng.uniform(1.5, 2.5), low, high)
    return drawing.grid(*(0.5 if rng.random() < 0.5 else 0.0 for _ in range(2)))


def office(rng: Random, layout: Random, rooms: int, furniture: int = 3) -> tuple[Grid, float]:
    """
    Draw equal rooms along both sides of a corridor; doors that were open and furniture differ.

    Returns the map and the width of a room [m].
    """
    width, depth, aisle = layout.uniform(2.8, 4.5), layout.uniform(3, 5), layout.uniform(1.6, 2.6)
    door = layout.uniform(0.5, width - 1.5)
    drawing = Drawing(rooms * width, 2.0 * depth + aisle)
    drawing.free(0.0, rooms * width, depth, depth + aisle)
    for x in np.arange(rooms) * width:
        for low, gap in ((0.0, depth - 0.2), (depth + aisle + 0.12, depth + aisle - 0.05)):
            if rng.random() > 0.85:
                continue
            drawing.free(x + 0.06, x + width - 0.06, low, low + depth - 0.12)
            drawing.free(x + door, x + door + 0.9, gap, gap + 0.25)
            for _ in range(rng.integers(0, furniture + 1)):
                spot = x + rng.uniform(0.3, width - 1.2), low + rng.uniform(0.4, depth - 1.2)
                drawing.fill(spot[0], spot[0] + rng.uniform(0.3, 0.9), spot[1], spot[1] + 0.6)
    return drawing.grid(), width


def building(own: Random, width: float, height: float, plan: Random | None = None,
             planned: float = np.inf) -> Grid:
    """
    Draw rooms of all sizes, by cutting a rectangle again and again, each cut with a door.

    Areas of more than `planned` [m2] are cut as a plan says, which storeys may share.
    """
    drawing, rooms, doors = Drawing(width, height), [(0.0, width, 0.0, height)], []
    while rooms:
        x0, x1, y0, y1 = rooms.pop()
        w, h = x1 - x0, y1 - y0
        rng = plan if w * h > planned else own
        share = rng.uniform(0.3, 0.7)
        if max(w, h) < rng.uniform(4.0, 9.0):
            drawing.free(x0 + 0.08, x1 - 0.08, y0 + 0.08, y1 - 0.08)
            for _ in range(rng.integers(0, 3)):
                x, y = rng.uniform(x0 + 0.3, x1 - 0.6), rng.uniform(y0 + 0.3, y1 - 0.6)
                drawing.fill(x, min(x + rng.uniform(0.3, 1.2), x1 - 0.2),
                             y, min(y + rng.uniform(0.3, 0.8), y1 - 0.2))
        elif w > h:
            middle, at = x0 + share * w, rng.uniform(y0 + 0.3, max(y1 - 1.3, y0 + 0.3))
            rooms += [(x0, middle, y0, y1), (middle, x1, y0, y1)]
            doors.append((middle - 0.2, middle + 0.2, at, at + 0.9))
        else:
            middle, at = y0 + share * h, rng.uniform(x0 + 0.3, max(x1 - 1.3, x0 + 0.3))
            rooms += [(x0, x1, y0, middle), (x0, x1, middle, y1)]
            doors.append((at, at + 0.9, middle - 0.2, middle + 0.2))
    for door in doors:
        drawing.free(*door)
    return drawing.grid()


class Drawing:
    """Rectangles [m] of free space in the unknown; what borders on them is wall."""

    def __init__(self, width: float, height: float) -> None:
        """Leave one metre around."""
        self.image = np.zeros((int((height + 2) / CELL), int((width + 2) / CELL)), np.uint8)

    def free(self, x0: float, x1: float, y0: float, y1: float, value: int = 1) -> None:
        """Open a rectangle."""
        ends = [int((edge + 1.0) / CELL) for edge in (x0, y0, x1, y1)]
        self.image[ends[1]:ends[3], ends[0]:ends[2]] = value

    def fill(self, x0: float, x1: float, y0: float, y1: float) -> None:
        """Close a rectangle."""
        self.free(x0, x1, y0, y1, 0)

    def grid(self, left: float = 0.0, right: float = 0.0) -> Grid:
        """Make the map; a part [m] at the left and the right end was not seen."""
        wall = (cv2.dilate(self.image, np.ones((3, 3), np.uint8)) > 0) & (self.image == 0)
        evidence = np.where(wall, -1.0, self.image).astype(np.float32)
        if left:
            evidence[:, :int((1.0 + left) / CELL)] = 0.0
        if right:
            evidence[:, -int((1.0 + right) / CELL):] = 0.0
        return Grid(evidence, CELL)
