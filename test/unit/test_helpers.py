# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fakes themselves are right: other tests take them for the truth."""

from helpers import (cut_grid, fake_grid, fake_odometry, fake_room, fake_scan, fake_trajectory,
                     pose_error, ray_cast, walls_in)
import numpy as np
from somfusion_ros.geometry import apply, compose, Pose


def test_ray_cast_measures_a_room_from_its_middle() -> None:
    walls = np.array([[0, 0, 4, 0], [4, 0, 4, 2], [4, 2, 0, 2], [0, 2, 0, 0]], dtype=float)
    distances = ray_cast(walls, np.array([1.0, 1.0, 0.0]), np.deg2rad([0.0, 90.0, 180.0, -45.0]))
    np.testing.assert_allclose(distances, [3.0, 1.0, 1.0, np.sqrt(2.0)], atol=1e-9)


def test_scan_points_lie_on_the_walls_of_the_map() -> None:
    walls, pose = fake_room(), np.array([2.0, 2.0, 0.7])
    scan = fake_scan(walls, pose, T_base_laser=Pose(0.1, 0.0, 0.2))
    seen = np.isfinite(scan.ranges)
    bearings = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    points = scan.ranges[seen, None] * np.column_stack(
        [np.cos(bearings[seen]), np.sin(bearings[seen])])
    points = apply(compose(pose, scan.T_base_laser), points)
    grid = fake_grid(walls)
    wall_points = grid.points(grid.occupied)
    nearest = np.hypot(*(points[:, None] - wall_points).transpose(2, 0, 1)).min(1)
    assert seen.sum() > 200
    assert nearest.max() <= grid.resolution


def test_turned_map_holds_the_turned_walls() -> None:
    walls, T = fake_room(), Pose(3.0, -2.0, 2.5)
    grid = fake_grid(walls, T_map_walls=T)
    turned = walls_in(T, walls)
    cells = grid.point_to_cell(0.5 * (turned[:, :2] + turned[:, 2:]))
    around = [grid.evidence[r - 1:r + 2, c - 1:c + 2].min() for r, c in cells]
    assert max(around) == -1.0
    assert grid.free.sum() * grid.resolution ** 2 > 30.0


def test_cut_keeps_the_frame() -> None:
    grid = fake_grid(fake_room())
    part = cut_grid(grid, (0.0, 0.0), (4.0, 6.0))
    assert part.shape == grid.shape
    assert part.points(part.known)[:, 0].max() <= 4.0
    assert 0 < part.known.sum() < grid.known.sum()


def test_trajectory_looks_where_it_goes_and_odometry_drifts_from_it() -> None:
    stamps, poses = fake_trajectory(np.array([[1, 1], [5, 1], [5, 4]]))
    assert np.abs(np.diff(np.unwrap(poses[:, 2]))).max() < 0.3
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.5 * 0.1 + 1e-9
    assert len(stamps) == len(poses)
    odometry = fake_odometry(poses)
    distance, _ = pose_error(compose(poses[0], odometry[-1]), poses[-1])
    assert 0.0 < distance < 0.5
