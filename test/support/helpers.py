# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fakes with known truth, made in one place: rooms, maps of them, trajectories, scans."""

from collections.abc import Sequence
import importlib
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from somfusion_ros.geometry import apply, Array, between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.ros.apps.processes import node_environment
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.scan import Cloud, Scan
from somfusion_ros.slam.tracking import Tracker

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get('SOMFUSION_DATA', ROOT.parent / 'shared')) / 'data'


def need_data(*parts: str) -> Path:
    """Return the path of shared test data, or skip the calling test with a reason."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f'{"/".join(parts)} is not on this machine (set SOMFUSION_DATA)')
    return path


def need_ros() -> None:
    """Skip the calling module where rclpy is missing; on CI a missing rclpy is a failure."""
    if os.environ.get('CI', '').lower() in ('1', 'true', 'yes'):
        importlib.import_module('rclpy')
    pytest.importorskip('rclpy')


def need_tf() -> None:
    """Skip the calling module where tf2_msgs is missing; on CI that is a failure."""
    if os.environ.get('CI', '').lower() in ('1', 'true', 'yes'):
        importlib.import_module('tf2_msgs.msg')
    pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is missing: scripts/make_tf2_msgs.py')


def fake_room(width: float = 8.0, height: float = 6.0) -> Array:
    """
    Walls (N, 4) as x0 y0 x1 y1 [m] of a room that looks the same from no other pose.

    The corner is at the origin; an alcove, a partition and a pillar break every symmetry.
    """
    w, h = width, height
    corners = [(0, 0), (w, 0), (w, 0.55 * h), (0.85 * w, 0.55 * h), (0.85 * w, 0.8 * h),
               (w, 0.8 * h), (w, h), (0, h)]
    outline = [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    partition = [(0.4 * w, h, 0.4 * w, 0.6 * h), (0.4 * w, 0.6 * h, 0.55 * w, 0.6 * h)]
    x, y, s = 0.65 * w, 0.25 * h, 0.4
    pillar = [(x, y, x + s, y), (x + s, y, x + s, y + s), (x + s, y + s, x, y + s),
              (x, y + s, x, y)]
    return np.array(outline + partition + pillar, dtype=float)


def furnished_room(width: float = 14.0, height: float = 11.0, seed: int = 7) -> Array:
    """Walls (N, 4) [m] of a room with things in it that no part of the room has twice."""
    rng, walls = np.random.default_rng(seed), [fake_room(width, height)]
    for x in np.arange(1.2, width - 1.0, 2.3):
        for y in np.arange(1.0, height - 2.0, 2.4):
            w, h = rng.uniform(0.3, 1.4, 2)
            a, b = x + rng.uniform(0, 0.7), y + rng.uniform(0, 0.7)
            walls.append([(a, b, a + w, b), (a + w, b, a + w, b + h), (a + w, b + h, a, b + h),
                          (a, b + h, a, b)])
    return np.concatenate(walls)


def fake_grid(walls: Array, resolution: float = 0.05, T_map_walls: Pose | None = None,
              margin: float = 1.0) -> Grid:
    """
    Map of closed walls (N, 4): occupied on the walls, free inside the outline, unknown outside.

    The grid is drawn in the walls' own frame and placed by its origin, so a turned map is exact.
    """
    low = walls.reshape(-1, 2).min(0) - margin
    high = walls.reshape(-1, 2).max(0) + margin
    columns, rows = np.ceil((high - low) / resolution).astype(int)
    drawn = np.zeros((rows, columns), np.uint8)
    for wall in walls:
        (c0, r0), (c1, r1) = np.floor((wall.reshape(2, 2) - low) / resolution).astype(int)
        cv2.line(drawn, (int(c0), int(r0)), (int(c1), int(r1)), 1)
    outside = drawn.copy()
    cv2.floodFill(outside, None, (0, 0), 2)
    evidence = np.where(drawn == 1, -1.0, np.where(outside == 2, 0.0, 1.0)).astype(np.float32)
    origin = compose(T_map_walls or Pose(), (*low, 0.0))
    return Grid(evidence, resolution, Pose.from_array(origin))


def cut_grid(grid: Grid, low: tuple[float, float], high: tuple[float, float]) -> Grid:
    """Forget what lies outside a box [m] of the map frame: a robot that saw a part only."""
    rows, columns = np.indices(grid.shape)
    points = grid.cell_to_point(np.column_stack([rows.ravel(), columns.ravel()]))
    inside = ((points >= low) & (points <= high)).all(1).reshape(grid.shape)
    return Grid(np.where(inside, grid.evidence, 0.0), grid.resolution, grid.T_frame_grid)


def fake_trajectory(waypoints: Array, speed: float = 0.5, rate: float = 10.0
                    ) -> tuple[Array, Array]:
    """
    Stamps (N,) [s] and poses (N, 3) along waypoints (M, 2) [m], looking along smoothed motion.

    Corners are cut within 0.3 m so that the heading changes gradually, as a robot's does.
    """
    corners = np.asarray(waypoints, dtype=float)
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    along = np.concatenate([[0.0], lengths.cumsum()])
    stamps = np.arange(0.0, along[-1] / speed, 1.0 / rate)
    offsets = np.linspace(-0.3, 0.3, 7)
    where = np.clip(stamps[:, None] * speed + offsets, 0.0, along[-1])
    path = np.stack([np.interp(where, along, c).mean(1) for c in corners.T], -1)
    step = np.gradient(path, axis=0)
    return stamps, np.column_stack([path, np.arctan2(step[:, 1], step[:, 0])])


def ray_cast(walls: Array, pose: Array, bearings: Array) -> Array:
    """Distances (B,) [m] from a pose along bearings (B,) [rad] to the walls; inf where none."""
    angles = pose[2] + bearings
    direction = np.column_stack([np.cos(angles), np.sin(angles)])
    start, edge = walls[:, :2] - pose[:2], walls[:, 2:] - walls[:, :2]
    cross = direction[:, :1] * edge[:, 1] - direction[:, 1:] * edge[:, 0]
    with np.errstate(divide='ignore', invalid='ignore'):
        distance = (start[:, 0] * edge[:, 1] - start[:, 1] * edge[:, 0]) / cross
        share = (start[:, 0] * direction[:, 1:] - start[:, 1] * direction[:, :1]) / cross
    hit = (distance > 0.0) & (share >= -1e-9) & (share <= 1.0 + 1e-9)
    return np.where(hit, distance, np.inf).min(1)


def fake_scan(walls: Array, T_walls_base: Array, stamp: float = 0.0, beams: int = 513,
              field_of_view: float = np.deg2rad(240.0), range_max: float = 4.5,
              noise: float = 0.0, rng: np.random.Generator | None = None,
              T_base_laser: Pose | None = None) -> Scan:
    """Scan of walls (N, 4) from a pose; beams without a return are inf (REP-117)."""
    increment = field_of_view / (beams - 1)
    bearings = -0.5 * field_of_view + increment * np.arange(beams)
    mount = T_base_laser or Pose()
    ranges = ray_cast(walls, compose(T_walls_base, mount), bearings)
    if noise:
        ranges = ranges + noise * (rng or np.random.default_rng(0)).standard_normal(beams)
    ranges = np.where(ranges > range_max, np.inf, ranges)
    return Scan(stamp, ranges, bearings[0], increment, 0.05, range_max, 0.0, mount)


def fake_odometry(poses: Array, noise: tuple[float, float] = (0.02, 0.02),
                  rng: np.random.Generator | None = None) -> Array:
    """Drifting odometry (N, 3): true steps with an error in proportion to each, from zero."""
    rng = rng or np.random.default_rng(0)
    steps = between(poses[:-1], poses[1:])
    size = np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2])
    wrong = rng.standard_normal(steps.shape) * (noise[0], noise[0], noise[1]) * size[:, None]
    drifted = [np.zeros(3)]
    for step in steps + wrong:
        drifted.append(compose(drifted[-1], step))
    return np.array(drifted)


def pose_error(T_estimated: Array, T_true: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    x, y, theta = between(T_true, T_estimated)
    return float(np.hypot(x, y)), float(abs(theta))


def walls_in(T_target_walls: Array, walls: Array) -> Array:
    """Walls (N, 4) seen from another frame."""
    return apply(T_target_walls, walls.reshape(-1, 2)).reshape(-1, 4)


def ros_environment(domain: int | None = None) -> dict[str, str]:
    """Environment for node processes: their own domain, this package, message fields checked."""
    paths = [str(ROOT), *os.environ.get('PYTHONPATH', '').split(os.pathsep)]
    return {**node_environment(domain),
            'PYTHONPATH': os.pathsep.join(p for p in paths if p),
            'ROS_PYTHON_CHECK_FIELDS': '1'}


def write_fake_bag(folder: Path, walls: Array | None = None, waypoints: Array | None = None,
                   storage: str = 'mcap', every: int = 1, start: float = 100.0,
                   noise: float = 0.01) -> Array:
    """
    Write a bag of one robot in a room, as `BagWriter` does; return its true poses (N, 3).

    The odometry begins at zero and drifts a little; every n-th pose gets a scan.
    """
    walls = fake_room() if walls is None else walls
    if waypoints is None:
        waypoints = np.array([(1.0, 1.0), (4.0, 1.2), (6.5, 2.6), (4.0, 3.2), (1.5, 4.5)])
    stamps, poses = fake_trajectory(waypoints)
    rng = np.random.default_rng(len(stamps))
    odometry = fake_odometry(poses, (0.01, 0.01), rng)
    mount = Pose(0.1, 0.0, 0.0)
    with BagWriter(folder, storage) as bag:
        bag.mount(start, mount)
        for number, (stamp, pose, drifted) in enumerate(zip(stamps, poses, odometry)):
            bag.odometry(start + stamp, drifted)
            if number % every == 0:
                bag.scan(fake_scan(walls, pose, start + stamp, noise=noise, rng=rng,
                                   T_base_laser=mount))
    return poses


def checkpoint(stamps: Array, poses: Array, clouds: Sequence[Cloud],
               constraints: Sequence[Constraint], scans: Sequence[MapScan] = (),
               trail: Sequence[Sequence[float]] = ()) -> Checkpoint:
    """Checkpoint of a path (n, 3) as far as others are told of it."""
    return Checkpoint(np.asarray(poses), np.asarray(stamps, dtype=float), clouds, constraints,
                      scans, np.array(trail, dtype=float).reshape(-1, 5), (), 0,
                      Tracker(SlamConfig()).state())
