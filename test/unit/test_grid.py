# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grids: occupancy to evidence and back, cells to points and back, and what is refused."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid

cells = st.lists(st.lists(st.integers(-1, 100), min_size=3, max_size=3), min_size=1, max_size=5)


@given(cells.map(lambda rows: np.array(rows, np.int8)))
def test_occupancy_survives_the_way_there_and_back(occupancy):
    back = Grid.from_occupancy(occupancy, 0.05).to_occupancy()
    even = occupancy == 50
    np.testing.assert_array_equal(back[~even], occupancy[~even])
    assert (back[even] == -1).all(), '50 % is no evidence, the same as unknown'


def test_signs_of_the_evidence():
    grid = Grid.from_occupancy(np.array([[0, 100, -1]], np.int8), 0.1)
    np.testing.assert_allclose(grid.evidence, [[1.0, -1.0, 0.0]])
    assert grid.free.tolist() == [[True, False, False]]
    assert grid.occupied.tolist() == [[False, True, False]]
    assert grid.known.tolist() == [[True, True, False]]


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-4, 4), st.floats(0.02, 0.5))
def test_cells_and_points_are_inverse(x, y, yaw, resolution):
    grid = Grid(np.zeros((7, 9), np.float32), resolution, Pose(x, y, yaw))
    every = np.argwhere(np.ones(grid.shape, bool))
    np.testing.assert_array_equal(grid.point_to_cell(grid.cell_to_point(every)), every)


def test_a_turned_origin_turns_the_cells():
    grid = Grid(np.full((1, 3), -1, np.float32), 1.0, Pose(2.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(grid.points(grid.occupied), [[1.5, 0.5], [1.5, 1.5], [1.5, 2.5]])


@pytest.mark.parametrize('data, resolution, origin, reason', [
    (np.zeros((0, 4)), 0.05, (0, 0, 0), 'at least one cell'),
    (np.zeros(9), 0.05, (0, 0, 0), 'two sides'),
    (np.zeros((2, 2)), 0.0, (0, 0, 0), 'resolution'),
    (np.zeros((2, 2)), -1.0, (0, 0, 0), 'resolution'),
    (np.zeros((2, 2)), np.nan, (0, 0, 0), 'resolution'),
    (np.zeros((2, 2)), 0.05, (np.nan, 0, 0), 'origin'),
    (np.zeros((2, 2)), 0.05, (0, 0), 'origin'),
    (np.broadcast_to(np.int8(0), (40000, 40000)), 0.05, (0, 0, 0), 'over'),
])
def test_what_is_no_grid_is_refused_with_its_reason(data, resolution, origin, reason):
    with pytest.raises(ValueError, match=reason):
        Grid.from_occupancy(data, resolution, origin)


@pytest.mark.parametrize('value', [np.nan, 1.5, -2.0])
def test_evidence_must_stay_in_its_range(value):
    with pytest.raises(ValueError, match='evidence'):
        Grid(np.full((2, 2), value, np.float32), 0.05)
