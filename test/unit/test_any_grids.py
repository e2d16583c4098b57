# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grids as other SLAMs make them: any values, any part of the place, cluttered, almost empty."""

from collections.abc import Callable

from helpers import cut_grid, fake_grid, pose_error
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import align
from somfusion_ros.geometry import compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.floor_plan import office

SPOT = (7.0, 5.0, 0.0)      # where poses are compared, in the floor's frame [m]


def with_evidence(grid: Grid, evidence: np.ndarray) -> Grid:
    """Keep a grid's frame, with other cells."""
    return Grid(evidence.astype(np.float32), grid.resolution, grid.T_frame_grid)


def walls_only(grid: Grid) -> Grid:
    """Make all free that is no wall, as in maps of 0 and 100 only."""
    return with_evidence(grid, np.where(grid.occupied, -1.0, 1.0))


def graded(grid: Grid) -> Grid:
    """Weaken the evidence by chance, down to what still counts as wall or free."""
    share = np.random.default_rng(0).uniform(0.65, 1.0, grid.shape)
    return with_evidence(grid, grid.evidence * share)


def cluttered(grid: Grid) -> Grid:
    """Put up twenty boxes of half a metre."""
    evidence, rng = grid.evidence.copy(), np.random.default_rng(1)
    for row, column in rng.permutation(np.argwhere(grid.free))[:20]:
        evidence[row:row + 10, column:column + 10] = -1.0
    return with_evidence(grid, evidence)


def inside(grid: Grid) -> Grid:
    """Keep only a part in the middle."""
    return cut_grid(grid, (2.0, -1.0), (14.0, 11.0))


def speckled(grid: Grid) -> Grid:
    """Lose a third of the wall, and get one cell in two hundred wrong."""
    rng, evidence = np.random.default_rng(2), grid.evidence.copy()
    evidence[grid.occupied & (rng.random(grid.shape) < 0.33)] = 0.0
    evidence[grid.free & (rng.random(grid.shape) < 0.005)] = -1.0
    return with_evidence(grid, evidence)


def lost_in_the_unknown(grid: Grid) -> Grid:
    """Put the place into a grid a hundred times as large."""
    height, width = grid.shape
    evidence = np.zeros((10 * height, 10 * width), np.float32)
    evidence[4 * height:5 * height, 7 * width:8 * width] = grid.evidence
    corner = compose(grid.T_frame_grid, (-7 * width * grid.resolution,
                                         -4 * height * grid.resolution, 0.0))
    return Grid(evidence, grid.resolution, Pose.from_array(corner))


@pytest.mark.parametrize('change', [walls_only, graded, cluttered, inside, speckled,
                                    lost_in_the_unknown])
def test_maps_of_other_makers_are_placed_right(change: Callable[[Grid], Grid]) -> None:
    """A floor and the same floor of another kind, turned: right within 0.1 m and 0.5 deg."""
    T = Pose(3.0, -2.0, 0.9)
    found = align(fake_grid(office().segments, 0.05, T), change(fake_grid(office().segments)))
    assert found.accepted, found.reason
    distance, angle = pose_error(compose(found.T_target_source, SPOT), compose(T, SPOT))
    assert distance < 0.1 and angle < np.radians(0.5)


@pytest.mark.parametrize('resolutions', [(0.02, 0.02), (0.02, 0.05), (0.1, 0.02), (0.1, 0.05)])
def test_fine_and_mixed_resolutions(resolutions: tuple[float, float]) -> None:
    """A floor drawn in two resolutions: right within a cell of the coarser, and 0.5 deg."""
    T = Pose(-4.0, 1.0, -2.2)
    target, source = (fake_grid(office().segments, resolution, at)
                      for resolution, at in zip(resolutions, (T, Pose()), strict=True))
    found = align(target, source)
    assert found.accepted, found.reason
    distance, angle = pose_error(compose(found.T_target_source, SPOT), compose(T, SPOT))
    assert distance < max(resolutions) and angle < np.radians(0.5)


def outdoors(seed: int, low: float, high: float, T: Pose) -> Grid:
    """Draw part of a yard of 60 x 40 m, between two x [m]: trunks, sheds, no wall around."""
    rng, evidence = np.random.default_rng(seed), np.ones((800, 1200), np.float32)
    for size, count in ((8, 50), (60, 8)):
        for row, column in zip(rng.integers(0, 740, count), rng.integers(0, 1140, count),
                               strict=True):
            height, width = rng.integers(size // 2, size, 2)
            evidence[row:row + height, column:column + width] = -1.0
            evidence[row + 1:row + height - 1, column + 1:column + width - 1] = 0.0
    evidence[:, :int(20 * low)] = evidence[:, int(20 * high):] = 0.0
    return Grid(evidence, 0.05, T)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
def test_sparse_maps_of_outdoors_are_placed_right_and_others_refused(seed: int) -> None:
    """Two robots saw two thirds of a yard each: right within 0.1 m, 0.5 deg; not another yard."""
    T = Pose(12.0, -7.0, 2.5)
    target = outdoors(seed, 0.0, 40.0, T)
    found = align(target, outdoors(seed, 20.0, 60.0, Pose()))
    assert found.accepted, found.reason
    spot = (30.0, 20.0, 0.0)
    distance, angle = pose_error(compose(found.T_target_source, spot), compose(T, spot))
    assert distance < 0.1 and angle < np.radians(0.5)
    other = align(target, outdoors(seed + 100, 20.0, 60.0, Pose()))
    assert not other.accepted, other.reason


@settings(max_examples=8, deadline=None)
@given(st.integers(20, 60), st.integers(20, 60), st.integers(0, 10 ** 6))
def test_tiny_maps_never_raise_and_agree_both_ways(rows: int, columns: int, seed: int) -> None:
    """Maps of 20 to 60 cells a side: some verdict, the same both ways."""
    rng = np.random.default_rng(seed)
    maps = [Grid(np.where(rng.random((rows, columns)) < 0.1, -1.0, 1.0).astype(np.float32), 0.05)
            for _ in range(2)]
    forth, back = align(*maps), align(*maps[::-1])
    assert (forth.accepted, forth.probability) == (back.accepted, back.probability)
    assert not forth.accepted, 'noise is no place'
