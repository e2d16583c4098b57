# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global map: evidence sums, origins and yaw count, the anchor stays, bounds grow."""

from helpers import fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from numpy.typing import NDArray
import pytest
from somfusion_ros.geometry import apply, between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.global_map import merge_grids

QUARTERS = [0.0, np.pi / 2, np.pi, -np.pi / 2]


def evidence_at(grid: Grid, points: NDArray) -> NDArray:
    """Look points (N, 2) up, all of which lie inside."""
    return grid.evidence[tuple(grid.point_to_cell(points).T)]


def random_grid(seed: int, shape: tuple[int, int], origin: Pose) -> Grid:
    """Draw walls, free and unknown cells at random."""
    values = np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], size=shape)
    values[0, 0] = values[-1, -1] = -1.0   # so that the known part is the whole
    return Grid(values.astype(np.float32), 0.05, origin)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10 ** 6), st.tuples(st.integers(1, 40), st.integers(1, 40)),
       st.tuples(st.integers(-200, 200), st.integers(-200, 200)), st.sampled_from(QUARTERS))
def test_a_map_on_the_lattice_is_drawn_cell_by_cell(
        seed: int, shape: tuple[int, int], offset: tuple[int, int], turn: float) -> None:
    grid = random_grid(seed, shape, Pose(0.35, -1.2, 0.0))
    T_world_map = Pose(0.05 * offset[0], 0.05 * offset[1], turn)
    merged = merge_grids({'a': grid}, {'a': T_world_map})
    known = grid.known
    found = evidence_at(merged, apply(T_world_map, grid.points(known)))
    assert np.array_equal(found, grid.evidence[known])
    assert np.count_nonzero(merged.known) == np.count_nonzero(known)


def test_evidence_is_summed_not_maximised() -> None:
    def cell(value: float) -> Grid:
        return Grid(np.full((1, 1), value, np.float32), 0.1)
    for values, total in (((0.5, -0.2), 0.3), ((1.0, -1.0), 0.0), ((-0.8, -0.8), -1.0)):
        grids = dict(zip('ab', map(cell, values)))
        merged = merge_grids(grids, {'a': Pose(), 'b': Pose()})
        assert merged.evidence[0, 0] == pytest.approx(total, abs=1e-6)


@pytest.mark.parametrize('yaw', [0.0, 0.4, np.pi / 2, -2.5])
def test_the_origin_of_a_map_counts_with_its_yaw(yaw: float) -> None:
    walls = fake_room()
    straight = fake_grid(walls)
    turned = fake_grid(walls, T_map_walls=Pose(3.0, -2.0, yaw))
    T_turned_straight = Pose(3.0, -2.0, yaw)
    merged = merge_grids({'a': straight, 'b': turned},
                         {'a': Pose(), 'b': Pose.from_array(between(T_turned_straight, Pose()))})
    one = merge_grids({'a': straight}, {'a': Pose()})
    # The same place seen twice, from two frames: walls agree to a cell, nothing is drawn beside.
    assert abs(int(merged.occupied.sum()) - int(one.occupied.sum())) < 0.2 * one.occupied.sum()
    walls_found = evidence_at(merged, straight.points(straight.occupied))
    assert (walls_found < 0).mean() > 0.85


@settings(max_examples=25, deadline=None)
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-np.pi, np.pi))
def test_any_pose_keeps_what_lies_inside(x: float, y: float, theta: float) -> None:
    values = np.ones((30, 40), np.float32)
    values[10:20, 10:30] = -1.0
    grid = Grid(values, 0.05, Pose(1.0, 2.0, 0.3))
    merged = merge_grids({'a': grid}, {'a': Pose(x, y, theta)})
    inner = np.zeros(grid.shape, bool)
    inner[12:18, 12:28] = True   # two cells off every edge, where rounding decides nothing
    assert (evidence_at(merged, apply(Pose(x, y, theta), grid.points(inner))) == -1.0).all()
    # Resampling keeps the area: no holes, no doubles.
    assert abs(int(merged.known.sum()) - values.size) < 0.03 * values.size


def test_the_anchor_lies_on_a_cell_corner_and_bounds_only_grow() -> None:
    room, poses = fake_grid(fake_room()), {'a': Pose(), 'b': Pose(7.123, 3.456, 0.7)}
    small = merge_grids({'a': room}, poses)
    large = merge_grids({'a': room, 'b': room}, poses)
    for grid in (small, large):
        corner = np.array(grid.T_frame_grid[:2]) / grid.resolution
        assert np.allclose(corner, np.rint(corner), atol=1e-6)
        assert grid.T_frame_grid.theta == 0.0
    shift = (np.array(small.T_frame_grid[:2]) - large.T_frame_grid[:2]) / small.resolution
    column, row = np.rint(shift).astype(int)
    assert column >= 0
    assert row >= 0
    window = large.evidence[row:row + small.shape[0], column:column + small.shape[1]]
    alone = merge_grids({'b': room}, poses)
    outside = evidence_where(alone, small) == 0
    assert np.array_equal(window[outside], small.evidence[outside])


def evidence_where(grid: Grid, frame: Grid) -> NDArray:
    """Look a map up at the cells of another one on the same lattice; 0 outside."""
    rows, columns = np.indices(frame.shape)
    cells = grid.point_to_cell(frame.cell_to_point(np.column_stack([rows.ravel(),
                                                                    columns.ravel()])))
    inside = ((cells >= 0) & (cells < grid.shape)).all(1)
    values = np.zeros(len(cells), np.float32)
    values[inside] = grid.evidence[tuple(cells[inside].T)]
    return values.reshape(frame.shape)


def test_different_resolutions_meet_in_the_finest() -> None:
    walls = fake_room()
    fine, coarse = fake_grid(walls, 0.05), fake_grid(walls, 0.1)
    merged = merge_grids({'a': fine, 'b': coarse}, {'a': Pose(), 'b': Pose()})
    assert merged.resolution == 0.05
    assert (evidence_at(merged, fine.points(fine.occupied)) < 0).mean() > 0.9


def test_thin_walls_survive_a_coarse_world() -> None:
    grid = fake_grid(fake_room(), 0.05)
    merged = merge_grids({'a': grid}, {'a': Pose(0.013, 0.021, 0.2)}, resolution=0.2)
    walls = apply(Pose(0.013, 0.021, 0.2), grid.points(grid.occupied))
    assert merged.resolution == 0.2
    assert (evidence_at(merged, walls) < 0).mean() > 0.95


def test_robots_without_a_pose_or_a_map_are_left_out() -> None:
    grid = fake_grid(fake_room())
    merged = merge_grids({'a': grid, 'b': grid}, {'a': Pose(), 'c': Pose(1, 1, 1)})
    assert np.array_equal(merged.evidence, merge_grids({'a': grid}, {'a': Pose()}).evidence)
    with pytest.raises(ValueError, match='no robot'):
        merge_grids({'b': grid}, {'a': Pose()})


def test_maps_that_know_nothing_make_a_world_that_knows_nothing() -> None:
    merged = merge_grids({'a': Grid(np.zeros((5, 7), np.float32), 0.05)}, {'a': Pose()})
    assert not merged.known.any()


def test_maps_too_far_apart_are_refused_before_memory_is_taken() -> None:
    grid = fake_grid(fake_room())
    with pytest.raises(ValueError, match='too large'):
        merge_grids({'a': grid, 'b': grid}, {'a': Pose(), 'b': Pose(1e6, 1e6, 0.0)})
    with pytest.raises(ValueError, match='too far from the world origin: at'):
        merge_grids({'a': grid}, {'a': Pose(1e300, 0.0, 0.0)})


def test_three_maps(rng: np.random.Generator) -> None:
    walls = fake_room()
    frames = {name: Pose(*rng.uniform(-5, 5, 2), rng.uniform(-3, 3)) for name in 'abc'}
    grids = {name: fake_grid(walls, T_map_walls=T) for name, T in frames.items()}
    poses = {name: Pose.from_array(compose(Pose(), between(T, Pose())))
             for name, T in frames.items()}
    merged = merge_grids(grids, poses)   # the world is the frame of the walls
    truth = fake_grid(walls)
    assert (evidence_at(merged, truth.points(truth.occupied)) < 0).mean() > 0.85
