# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What changes in a building: loose pieces carried away, walls put in, walls opened into rooms."""

import cv2
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid

Random = np.random.Generator
DOOR = 1.3     # m, of free space that is a door, at most


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


def closed_doors(grid: Grid, rng: Random, share: float) -> Grid:
    """Close a share of the doors; what is cut off so from the largest part was never seen."""
    r, small = grid.resolution, np.ones((3, 3), np.uint8)
    width = cv2.distanceTransform(grid.free.astype(np.uint8), cv2.DIST_L2, 5)
    inner = width * r > DOOR / 2.0
    room = cv2.connectedComponents(inner.astype(np.uint8))[1]
    away, spot = cv2.distanceTransformWithLabels((~inner).astype(np.uint8), cv2.DIST_L2, 5,
                                                 labelType=cv2.DIST_LABEL_PIXEL)
    rooms = np.zeros(spot.max() + 1)
    rooms[spot[inner]] = room[inner]
    near = np.where(grid.free & (away * r < DOOR), rooms[spot], 0.0).astype(np.float32)
    most = cv2.dilate(near, small)
    least = cv2.erode(np.where(near > 0.0, near, np.float32(1e6)), small)
    door = grid.free & (least < most) & (most > 0.0)
    pair = np.where(door, 31.0 * most + 17.0 * least, 0.0).astype(np.intp) % 1009
    shut = door & (rng.random(1009)[pair] < share)     # all cells between two rooms alike
    count, part = cv2.connectedComponents((grid.free & ~shut).astype(np.uint8), connectivity=4)
    sizes = np.bincount(part[grid.free & ~shut], minlength=count)
    kept = (part == sizes.argmax()).astype(np.uint8)
    seen = cv2.dilate(kept, np.ones((5, 5), np.uint8)) > 0
    return Grid(np.where(seen, np.where(shut, np.float32(-1.0), grid.evidence), np.float32(0.0)),
                r, grid.T_frame_grid)


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


def changed(grid: Grid, other: Grid, clear: float = 0.7) -> tuple[float, float]:
    """
    Tell how much two maps of one frame and shape differ in their walls.

    Returns
    -------
    length [m] of wall that stands in what the other map knows to be free, `clear` [m] away from
    all that it does not, mean of both maps; area [m2] that both know to be free
    """
    total = 0.0
    for one, by in ((grid, other), (other, grid)):
        free = by.free.astype(np.uint8)
        distance = cv2.distanceTransform(free, cv2.DIST_L2, 3) * grid.resolution
        total += np.count_nonzero(one.occupied & (distance > clear)) * grid.resolution / 2.0
    return total, np.count_nonzero(grid.free & other.free) * grid.resolution ** 2
