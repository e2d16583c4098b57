# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made from maps and from nothing: bent, worn, cut, mirrored; corridors and offices."""

from collections.abc import Callable

import cv2
import numpy as np
from somfusion_ros.geometry import apply, Array, compose, inverse, Pose
from somfusion_ros.grid import Grid

Random = np.random.Generator
Warped = Callable[[Array], Array]
CELL = 0.05


def bend(grid: Grid, degrees: float, rng: Random) -> tuple[Grid, Warped]:
    """
    Bend a map as drift does, by an angle over its length.

    Returns the bent map, and the function that takes points of the straight map to it.
    """
    rows, columns = np.nonzero(grid.free)
    local = np.column_stack([columns, rows]) * grid.resolution
    size, centre = np.ptp(np.percentile(local, [5, 95], axis=0), axis=0), local.mean(0)
    u = np.eye(2)[size.argmax()]
    v, k = np.array([-u[1], u[0]]), np.radians(degrees) / size.max() * rng.choice([-1, 1])

    def straighten(points: Array) -> Array:
        s, t = (points - centre) @ u, (points - centre) @ v
        return centre + np.outer(s + k * s * t, u) + np.outer(t - 0.5 * k * s * s, v)

    def bent(points: Array) -> Array:
        wanted = apply(inverse(grid.T_frame_grid), points)
        found = wanted
        for _ in range(8):
            found = found + wanted - straighten(found)
        return apply(grid.T_frame_grid, found)
    return _resampled(grid, straighten), bent


def worn(grid: Grid, rng: Random, shake: float = 0.5, lost: float = 0.1,
         specks: float = 0.0005) -> Grid:
    """Lose a share of the walls, add specks, and shake walls by about `shake` cells."""
    evidence, chance = grid.evidence.copy(), rng.random(grid.shape, dtype=np.float32)
    evidence[grid.occupied & (chance < lost)] = 0.0
    evidence[grid.free & (chance < specks)] = -0.8
    row, column = np.indices(grid.shape, dtype=np.float32)
    shift = [cv2.resize(rng.normal(0.0, shake, [side // 40 + 2 for side in grid.shape]
                                   ).astype(np.float32), grid.shape[::-1],
                        interpolation=cv2.INTER_CUBIC) for _ in range(2)]
    evidence = cv2.remap(evidence, column + shift[0], row + shift[1], cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def furnished(grid: Grid, rng: Random, count: int) -> Grid:
    """Put boxes of 0.2 to 0.8 m into free space, as furniture that was moved."""
    evidence = grid.evidence.copy()
    wide = np.flatnonzero(cv2.erode(grid.free.astype(np.uint8), np.ones((9, 9), np.uint8)))
    for cell in rng.choice(wide, count if len(wide) else 0):
        row, column = divmod(int(cell), grid.shape[1])
        h, w = (rng.uniform(0.1, 0.4, 2) / grid.resolution).astype(int) + 1
        box = evidence[max(0, row - h):row + h, max(0, column - w):column + w]
        box[:] = 0.0
        box[[0, -1]] = box[:, [0, -1]] = -1.0
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def redrawn(grid: Grid, resolution: float) -> Grid:
    """Draw a map anew with larger cells; a cell with some wall is wall."""
    share = grid.resolution / resolution
    size = tuple(max(8, int(np.ceil(side * share))) for side in grid.shape[::-1])
    walls, free = (cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
                   for mask in (grid.occupied, grid.free))
    evidence = np.where(walls > 0.25 * share, -1.0, free > 0.4).astype(np.float32)
    return Grid(evidence, grid.resolution * grid.shape[1] / size[0], grid.T_frame_grid)


def turned(grid: Grid, rng: Random) -> Grid:
    """Give a map another frame."""
    T = rng.uniform(-9.0, 9.0), rng.uniform(-9.0, 9.0), rng.uniform(-3.1, 3.1)
    return Grid(grid.evidence, grid.resolution, Pose.from_array(compose(T, grid.T_frame_grid)))


def cut(grid: Grid, low: float, high: float) -> Grid:
    """Keep what lies between two distances [m] from the left edge."""
    evidence = grid.evidence.copy()
    evidence[:, :max(0, int(low / grid.resolution))] = 0.0
    evidence[:, max(0, int(high / grid.resolution)):] = 0.0
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def halves(grid: Grid, overlap: float, rng: Random) -> tuple[Grid, Grid]:
    """Cut a map in two that share a strip of `overlap` [m], or have a gap where it is negative."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    row, column = np.indices(grid.shape)
    along = (column * np.cos(angle) + row * np.sin(angle)) * grid.resolution
    middle = np.median(along[grid.free])
    parts = along < middle + overlap / 2.0, along > middle - overlap / 2.0
    return tuple(Grid(np.where(part, grid.evidence, 0.0), grid.resolution, grid.T_frame_grid)
                 for part in parts)


def mirrored(grid: Grid) -> Grid:
    """Give another place that looks alike."""
    return Grid(grid.evidence[:, ::-1], grid.resolution, grid.T_frame_grid)


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


def _resampled(grid: Grid, back: Warped) -> Grid:
    """Fill a map's cells from where a function of local points (N, 2) [m] says they come from."""
    row, column = np.indices(grid.shape)
    points = (np.column_stack([column.ravel(), row.ravel()]) + 0.5) * grid.resolution
    x, y = (back(points) / grid.resolution - 0.5).astype(np.float32).T.reshape(2, *grid.shape)
    evidence = cv2.remap(grid.evidence, np.ascontiguousarray(x), np.ascontiguousarray(y),
                         cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def scaled(grid: Grid, factor: float) -> Grid:
    """Draw a map larger or smaller than it is, as a sensor with a wrong scale does."""
    x, y, theta = grid.T_frame_grid
    return Grid(grid.evidence, grid.resolution * factor, Pose(x * factor, y * factor, theta))


def wobbled(grid: Grid, rng: Random, amplitude: float, length: float) -> Grid:
    """Shake a map smoothly, by about `amplitude` [m] over a `length` [m]."""
    nodes = [int(side * grid.resolution / length) + 3 for side in grid.shape]
    row, column = np.indices(grid.shape, dtype=np.float32)
    shift = [cv2.resize(rng.normal(0.0, amplitude / grid.resolution, nodes).astype(np.float32),
                        grid.shape[::-1], interpolation=cv2.INTER_CUBIC) for _ in range(2)]
    evidence = cv2.remap(grid.evidence, column + shift[0], row + shift[1], cv2.INTER_NEAREST)
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def emptied(grid: Grid, rng: Random, size: float, share: float = 1.0) -> Grid:
    """Carry a share of the loose pieces away that are smaller than `size` [m]."""
    reach = max(1, round(0.25 / grid.resolution))     # holes in a wall do not make it two
    near = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((reach, reach), np.uint8))
    count, label, facts, _ = cv2.connectedComponentsWithStats(near, connectivity=8)
    small = np.maximum(facts[:, cv2.CC_STAT_WIDTH], facts[:, cv2.CC_STAT_HEIGHT]) \
        * grid.resolution < size
    label = np.where(grid.occupied, label, 0)
    gone = small & (rng.random(count) < share)
    gone[0] = False
    return Grid(np.where(gone[label], np.float32(1.0), grid.evidence), grid.resolution,
                grid.T_frame_grid)


def meshed(grid: Grid, rng: Random) -> Grid:
    """Draw a map as from the mesh of a depth camera: no clutter, thick walls, holes in them."""
    grid = emptied(grid, rng, 1.5)
    thick = int(rng.integers(2, 5))
    walls = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((thick, thick), np.uint8)) > 0
    evidence = np.where(walls & grid.known, np.float32(-1.0), grid.evidence)
    spots = np.argwhere(walls)
    if len(spots) == 0:
        return grid
    for row, column in spots[rng.integers(len(spots), size=len(spots) // 600 + 1)]:
        r = int(rng.uniform(0.1, 0.6) / grid.resolution) + 1
        part = evidence[max(0, row - r):row + r, max(0, column - r):column + r]
        part[part < 0] = 0.0
    return wobbled(Grid(evidence, grid.resolution, grid.T_frame_grid), rng,
                   rng.uniform(0.03, 0.12), rng.uniform(2.0, 5.0))


def new_walls(grid: Grid, other: Grid, of: Array | None = None) -> float:
    """Length [m] of wall (of a mask) where another map of the same frame has free space."""
    near = cv2.dilate(other.occupied.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    new = grid.occupied & other.free & ~near
    return float((new if of is None else new & of).sum() * grid.resolution)


def drawn_as(grid: Grid, rng: Random, style: int) -> Grid:
    """Draw a map in greys (0), with thick walls and holes (1), or with much noise (2)."""
    if style == 0:
        grey = rng.uniform(0.62, 1.0, grid.shape).astype(np.float32)
        return Grid(grid.evidence * grey, grid.resolution, grid.T_frame_grid)
    if style == 1:
        thick = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        evidence = np.where(thick & grid.known, np.float32(-1.0), grid.evidence)
        return worn(Grid(evidence, grid.resolution, grid.T_frame_grid), rng, 0.5, 0.15, 0.0002)
    return worn(grid, rng, 1.5, 0.2, 0.003)


def partitioned(grid: Grid, rng: Random, count: int, longest: float) -> Grid:
    """Put straight walls of 1.5 m to `longest` [m] into free space, with a door in some."""
    evidence, r = grid.evidence.copy(), grid.resolution
    wide = np.flatnonzero(cv2.erode(grid.free.astype(np.uint8), np.ones((9, 9), np.uint8)))
    for cell in rng.choice(wide, count if len(wide) else 0):
        row, column = divmod(int(cell), grid.shape[1])
        across = rng.random() < 0.5
        line, at = (evidence[row], column) if across else (evidence[:, column], row)
        shut = np.flatnonzero(line <= 0.0)
        low = shut[shut < at].max(initial=-1) + 1
        high = shut[shut > at].min(initial=len(line))
        if (high - low) * r > longest:
            low = max(low, at - int(rng.uniform(0.3, 0.7) * longest / r))
            high = min(high, low + int(longest / r))
        if (high - low) * r < 1.5:
            continue
        gap = int(rng.integers(low, high)) if rng.random() < 0.5 else -10 ** 6
        keep = np.abs(np.arange(low, high) - gap) * r > 0.5
        line[low:high][keep] = -1.0
    return Grid(evidence, r, grid.T_frame_grid)


def extended(grid: Grid, rng: Random, count: int) -> Grid:
    """Open walls into rooms that are not there: 3 to 8 m wide, 1.5 to 4 m deep."""
    evidence, r = grid.evidence.copy(), grid.resolution
    spots = np.flatnonzero(grid.occupied)
    known = cv2.integral(cv2.dilate(grid.known.astype(np.uint8), np.ones((3, 3), np.uint8)))
    tries = 40 * count if len(spots) else 0
    for spot in rng.choice(spots, tries) if tries else ():
        row, column = divmod(int(spot), grid.shape[1])
        wide, deep, side = int(rng.uniform(3, 8) / r), int(rng.uniform(1.5, 4) / r), rng.random()
        turned = rng.random() < 0.5
        # The image is looked at transposed for rooms to the left and right of a wall.
        image, known_there = (evidence.T, known.T) if turned else (evidence, known)
        y, x = (column, row - wide // 2) if turned else (row, column - wide // 2)
        y = y + 2 if side < 0.5 else y - deep - 1
        if x < 2 or y < 2 or x + wide + 2 > image.shape[1] or y + deep + 2 > image.shape[0]:
            continue
        inside = (known_there[y + deep, x + wide] - known_there[y, x + wide]
                  - known_there[y + deep, x] + known_there[y, x])
        if inside > 0.1 * wide * deep:
            continue
        _open_room(image, x, y, wide, deep, side < 0.5)
        count -= 1
        if count == 0:
            break
    return Grid(evidence, r, grid.T_frame_grid)


def _open_room(image: Array, x: int, y: int, wide: int, deep: int, below: bool) -> None:
    """Draw a room of free cells with its walls, without the wall that it opens."""
    area = image[y - 1:y + deep + 1, x - 1:x + wide + 1]
    walls = np.ones(area.shape, bool)
    walls[1:-1, 1:-1] = False
    area[walls & (area <= 0.0)] = -1.0
    area[~walls] = 1.0
    low = y - 5 if below else y + deep - 1
    opened = image[max(low, 0):low + 6, x + 1:x + wide - 1]
    opened[opened < 0] = 1.0
