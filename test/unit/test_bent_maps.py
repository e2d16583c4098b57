# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bent maps and maps of another year are joined; storeys and mirrored halls are not."""

import cv2
from helpers import fake_grid, pose_error
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.verdict import VERDICT
from somfusion_ros.geometry import compose, Pose
from somfusion_ros.grid import Grid

WIDTH, HEIGHT, AISLE = 26.0, 14.0, (5.5, 8.0)
ROOMS = ((0.13, 0.19, 0.11, 0.24, 0.17, 0.16), (0.22, 0.12, 0.2, 0.15, 0.14, 0.17))
OTHER_ROOMS = ((0.27, 0.1, 0.26, 0.09, 0.28), (0.08, 0.3, 0.09, 0.26, 0.27))


def storey(rooms: tuple[tuple[float, ...], tuple[float, ...]], door: float = 0.3,
           chairs: int = 25, seed: int = 0) -> Grid:
    """Draw rooms of some widths on both sides of an aisle, in one and the same shell."""
    rng = np.random.default_rng(seed)
    walls = [(0, 0, WIDTH, 0), (WIDTH, 0, WIDTH, HEIGHT), (WIDTH, HEIGHT, 0, HEIGHT),
             (0, HEIGHT, 0, 0)]
    for y, back, shares in zip(AISLE, (0.0, HEIGHT), rooms, strict=True):
        ends = WIDTH * np.cumsum((0.0, *shares)) / sum(shares)
        for x0, x1 in zip(ends, ends[1:], strict=False):
            at = x0 + door * (x1 - x0)
            walls += [(x0, y, at, y), (at + 0.9, y, x1, y), (x1, back, x1, y)]
    for x, y in rng.uniform((0.6, 0.6), (WIDTH - 1.2, HEIGHT - 1.2), (chairs, 2)):
        w, h = rng.uniform(0.2, 0.6, 2)
        walls += [(x, y, x + w, y), (x + w, y, x + w, y + h), (x + w, y + h, x, y + h),
                  (x, y + h, x, y)]
    return fake_grid(np.array(walls, dtype=float))


def deformed(grid: Grid, scale: float, degrees: float) -> Grid:
    """Draw a map larger, and bent by an angle over its width; its middle stays."""
    row, column = (part.astype(np.float32) for part in np.indices(grid.shape))
    half = grid.shape[1] / 2.0
    bow = np.radians(degrees) / 2.0 * ((column - half) ** 2 / half - half / 3.0) / 2.0
    evidence = cv2.remap(grid.evidence, column, row + bow.astype(np.float32), cv2.INTER_NEAREST)
    x, y, _ = grid.T_frame_grid
    middle = np.array([WIDTH, HEIGHT]) / 2.0
    corner = middle + scale * (np.array([x, y]) - middle)
    return Grid(evidence, grid.resolution * scale, Pose(*corner, 0.0))


def moved(grid: Grid, pose: tuple[float, float, float]) -> Grid:
    """Give a map another frame, in which what was at the origin lies at a pose."""
    return Grid(grid.evidence, grid.resolution,
                Pose.from_array(compose(pose, grid.T_frame_grid)))


@pytest.mark.parametrize('scale, degrees', [(1.0, 3.0), (1.02, 0.0), (0.98, 2.0), (1.03, 1.0)])
def test_a_large_bent_overlap_is_joined(scale: float, degrees: float) -> None:
    """Scale up to 3 % and a bend of some degrees: accepted, right within 0.4 m and 2 degrees."""
    truth = (3.0, -2.0, 2.0)
    bent = deformed(storey(ROOMS, seed=1), scale, degrees)
    found = align(moved(storey(ROOMS, seed=1), truth), bent)
    assert found.accepted, found.reason
    middle = (WIDTH / 2.0, HEIGHT / 2.0, 0.0)
    distance, angle = pose_error(compose(found.T_target_source, middle), compose(truth, middle))
    assert distance < 0.4
    assert angle < np.radians(2.0)


def test_moved_furniture_is_no_contradiction() -> None:
    """All chairs stand elsewhere: the same storey, a year later."""
    found = align(storey(ROOMS, seed=1), moved(storey(ROOMS, seed=2), (1.0, 2.0, -0.7)))
    assert found.accepted, found.reason


def test_another_storey_is_refused() -> None:
    """The same shell and aisle, other rooms: walls stand where the other map is free."""
    found = align(storey(ROOMS, seed=1), moved(storey(OTHER_ROOMS, seed=2), (1.0, 2.0, -0.7)))
    assert not found.accepted, found.reason
    assert 'in the open' in found.reason


def test_a_mirrored_storey_is_refused_by_name() -> None:
    """Built the other way round, with the same shell and aisle: the mirror image fits better."""
    grid = storey((ROOMS[0], ROOMS[0]), seed=1)
    found = align(grid, Grid(grid.evidence[::-1], 0.05))
    assert not found.accepted, found.reason
    assert found.probability <= VERDICT.image_chance or 'mirror image' not in found.reason
