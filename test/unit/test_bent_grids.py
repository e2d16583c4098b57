# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Saved maps are bent where that makes them fit, and only there."""

from helpers import fake_grid, furnished_room
import numpy as np
import pytest
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import apply, Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.bent_grids import merge_bent, warped
from somfusion_ros.team.wall_agreement import wall_agreement

SIZE = (14.0, 11.0)


def curved(walls: Array, bend: float) -> Array:
    """Walls (N, 4) of a map whose heading drifted along x by bend [rad] over its width."""
    points = walls.reshape(-1, 2).copy()
    points[:, 1] += 0.5 * bend * points[:, 0] ** 2 / SIZE[0]
    return points.reshape(-1, 4)


def room(bend: float = 0.0, seed: int = 7) -> Grid:
    """Return the map of a room, bent."""
    walls = furnished_room(*SIZE, seed=seed)
    pieces = np.linspace(walls[:, :2], walls[:, 2:], 9)     # long walls bend, too
    short = np.concatenate([pieces[:-1], pieces[1:]], axis=2).reshape(-1, 4)
    return fake_grid(curved(short, bend))


def test_walls_agree_alike_whichever_map_is_the_first() -> None:
    """Where one of the maps has few walls, nothing is known."""
    evidence = np.ones((40, 40))
    evidence[5, 5:35] = -1.0
    post = np.ones((40, 40))
    post[5, 5:9] = -1.0
    wall, few = Grid(evidence, 0.05), Grid(post, 0.05)
    assert np.isnan([wall_agreement(wall, few), wall_agreement(few, wall)]).all()
    assert wall_agreement(wall, wall) == 1.0


def test_a_bent_map_is_straightened() -> None:
    grids = {'a': room(), 'b': room(0.06)}
    world = {'a': Pose(), 'b': Pose(0.0, -0.07, -0.01)}
    before = wall_agreement(grids['a'], warped(grids['b'], Warp(
        np.tile(np.float32([[0.0, -0.07]]), (2, 2, 1)), np.zeros(2), 20.0)))
    bent = merge_bent(grids, world)
    after = wall_agreement(bent.maps['a'], bent.maps['b'])
    assert after > before + 0.05
    assert after > 0.9
    assert bent.bends['a'] == 0.0
    assert 0.03 < bent.bends['b'] < 1.0


def test_maps_that_fit_stay_as_they_are() -> None:
    grids = {'a': room(), 'b': room()}
    bent = merge_bent(grids, {'a': Pose(), 'b': Pose()})
    assert bent.bends == {'a': 0.0, 'b': 0.0}
    assert np.array_equal(bent.maps['a'].evidence, bent.maps['b'].evidence)


@pytest.mark.parametrize('seed', [3, 11])
def test_a_different_place_is_hardly_bent_into_this_one(seed: int) -> None:
    grids = {'a': room(), 'b': room(seed=seed)}
    bent = merge_bent(grids, {'a': Pose(), 'b': Pose()})
    assert wall_agreement(bent.maps['a'], bent.maps['b']) < 0.8


def test_a_warp_moves_walls_by_what_it_says() -> None:
    grid = room()
    shift = Warp(np.tile(np.float32([[0.30, -0.15]]), (3, 3, 1)), np.full(2, -5.0), 12.0)
    moved = warped(grid, shift)
    walls = apply((0.30, -0.15, 0.0), grid.points(grid.occupied))
    assert moved.occupied.sum() == grid.occupied.sum()
    assert moved.occupied[tuple(moved.point_to_cell(walls).T)].mean() > 0.99


@pytest.mark.parametrize('shape', [(8, 33000), (33000, 8)])
def test_a_map_may_be_long(shape: tuple[int, int]) -> None:
    """No image of OpenCV has sides over 32766 cells, and the map gets a margin."""
    rng = np.random.default_rng(3)
    grid = Grid(rng.choice([-1.0, 0.0, 1.0], shape), 0.5, Pose(3.0, 4.0, 0.0))
    moved = warped(grid, Warp(np.tile(np.float32([[0.0, 1.0]]), (2, 2, 1)), np.zeros(2), 1e4))
    assert np.array_equal(moved.evidence[4:4 + shape[0] - 1, 2:-2], grid.evidence[:-1])
    assert moved.T_frame_grid == Pose(2.0, 3.0, 0.0)
