# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Angles of a LaserScan checked by one another, slices of clouds, two lasers on one robot."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.io.bags.writer import BagWriter, quaternion
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.io.scan_messages import angles, scan_from
from somfusion_ros.offline.result_bag import ResultBag
from somfusion_ros.offline.robot_run import run_robot
from somfusion_ros.simulation.floor_plan import box
from somfusion_ros.simulation.raycast import raycast
from somfusion_ros.slam.scan import cloud

PI, DEGREE = np.pi, np.pi / 180.0


@pytest.mark.parametrize(('told', 'meant'), [
    ((-PI, PI, -DEGREE), (-PI, DEGREE)),                       # a mirrored map
    ((PI, -PI, DEGREE), (PI, -DEGREE)),                        # turned by the driver
    ((-PI, PI, 1e-9), (-PI, DEGREE)),                          # next to nothing
    ((-PI, PI, 0.0), (-PI, DEGREE)), ((-PI, PI, np.nan), (-PI, DEGREE)),
    ((-180.0, 180.0, 1.0), (-PI, DEGREE)),                     # degrees
    ((0.0, 360.0, 1.0), (0.0, DEGREE)),
    ((-PI, PI, 1.0), (-PI, DEGREE)),                           # only the increment in degrees
    ((0.0, 2.0 * PI, 1.02 * DEGREE), (0.0, DEGREE))])          # fewer beams than usual
def test_angles_that_contradict_are_mended_where_that_is_clear(told: tuple, meant: tuple) -> None:
    start, increment, odd = angles(*told, 361)
    assert (start, increment) == pytest.approx(meant)
    assert odd


@pytest.mark.parametrize('told', [
    (-PI, PI, DEGREE), (PI, -PI, -DEGREE), (-PI, PI - DEGREE, DEGREE), (-PI, PI + DEGREE, DEGREE),
    (-2.0, 0.0, 0.01), (-PI, np.nan, DEGREE), (-1.0, -1.0, DEGREE)])
def test_angles_that_agree_or_are_not_set_are_left_as_they_are(told: tuple) -> None:
    """Drivers differ by a beam, or leave angle_max at 0."""
    assert angles(*told, 361) == (told[0], told[2], '')


def test_of_several_echoes_the_first_is_taken() -> None:
    message = SimpleNamespace(
        header=SimpleNamespace(frame_id='laser'), angle_min=-1.0, angle_max=1.0,
        angle_increment=1.0, range_min=0.1, range_max=10.0, time_increment=0.0,
        ranges=[SimpleNamespace(echoes=echoes) for echoes in ([1.0, 2.0], [], [3.0])])
    scan = scan_from(message, Mount(Pose(0.2, 0.0, 0.0)), 5.0)
    assert np.array_equal(scan.ranges, [1.0, np.nan, 3.0], equal_nan=True)
    assert (scan.stamp, scan.T_base_laser.x) == (5.0, 0.2)


def cloud_of(points: Array, kind: str = '<f4', tail: int = 4, rows: int = 1) -> SimpleNamespace:
    """Make a cloud of points (N, 3) whose fields are of a kind, with other bytes behind them."""
    size = np.dtype(kind).itemsize
    code = {'f4': 7, 'f8': 8}[kind[1:]]
    step = 3 * size + tail
    data = np.zeros((len(points), step), np.uint8)
    data[:, :3 * size] = np.frombuffer(
        np.ascontiguousarray(points, kind).tobytes(), np.uint8).reshape(len(points), 3 * size)
    return SimpleNamespace(
        header=SimpleNamespace(frame_id='laser'), height=rows, width=len(points) // rows,
        fields=[SimpleNamespace(name=name, offset=k * size, datatype=code, count=1)
                for k, name in enumerate('xyz')],
        is_bigendian=kind[0] == '>', point_step=step, row_step=step * (len(points) // rows),
        data=data.ravel(), is_dense=False)


def room_cloud(rings: tuple[float, ...] = (0.0,), beams: int = 360) -> tuple[Array, Array]:
    """Return what a laser of several rings at slopes sees in the middle of 4 x 4 m (N, 3)."""
    angles = 2.0 * PI * np.arange(beams) / beams
    ranges, _ = raycast(box(0.0, 0.0, 4.0, 4.0), np.zeros((beams, 2)), angles)
    return ranges, np.concatenate([np.column_stack([
        ranges * np.cos(angles), ranges * np.sin(angles), slope * ranges]) for slope in rings])


@pytest.mark.parametrize('kind', ['<f4', '>f4', '<f8'])
def test_a_flat_cloud_is_a_scan(kind: str) -> None:
    ranges, points = room_cloud()
    scan = scan_from(cloud_of(points, kind), Mount(Pose(0.1, 0.0, 0.0)), 7.0, '/points')
    assert (scan.stamp, scan.laser, scan.T_base_laser.x) == (7.0, '/points', 0.1)
    assert len(scan.ranges) == 360
    first = round(scan.angle_min / scan.angle_increment)
    np.testing.assert_allclose(np.roll(scan.ranges, first), ranges, atol=1e-3)


def test_of_a_cloud_the_walls_at_the_height_of_the_laser_count() -> None:
    """Sixteen rings from -15 to 15 degrees, with floor and ceiling, lost points, and no ring 0."""
    slopes = np.tan(np.radians(np.arange(-15.0, 16.0, 2.0)))
    ranges, points = room_cloud(tuple(slopes), beams=1800)
    floor = points[:, 2] < -0.4   # the laser sits 0.4 m above it
    points[floor] *= (-0.4 / points[floor, 2])[:, None]
    points[::7] = np.nan
    scan = scan_from(cloud_of(points, rows=16), Mount(Pose(), height=0.4), 7.0)
    seen = np.isfinite(scan.ranges)
    assert seen.mean() > 0.9
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    true, _ = raycast(box(0.0, 0.0, 4.0, 4.0), np.zeros((len(angles), 2)), angles)
    assert np.abs(scan.ranges - true)[seen].max() < 0.03


def test_a_cloud_seen_from_below_is_turned_over() -> None:
    points = np.array([(1.0, 1.0, -0.1), (2.0, 0.1, -3.0)])
    scan = scan_from(cloud_of(points), Mount(Pose(), upside_down=True), 7.0)
    [beam] = np.flatnonzero(np.isfinite(scan.ranges))
    assert scan.angle_min + scan.angle_increment * beam == pytest.approx(-PI / 4, abs=0.02)


@pytest.mark.parametrize(('name', 'value'), [
    ('fields', []), ('width', 10 ** 9), ('height', 10 ** 9), ('point_step', 4), ('point_step', 0),
    ('data', np.zeros(5, np.uint8)), ('row_step', 10 ** 9)])
def test_a_cloud_that_cannot_be_read_is_an_error(name: str, value: Any) -> None:
    message = cloud_of(np.ones((6, 3)), rows=2)
    setattr(message, name, value)
    with pytest.raises(ValueError, match='a cloud'):
        scan_from(message, Mount(Pose()), 1.0)


def test_an_empty_cloud_is_a_scan_without_returns() -> None:
    scan = scan_from(cloud_of(np.zeros((0, 3))), Mount(Pose()), 1.0)
    assert not np.isfinite(scan.ranges).any()


def test_a_bag_with_clouds_only_is_mapped(tmp_path: Path) -> None:
    """Bound: 0.1 m at the end of a drive of 9 m."""
    stamps, poses = fake_trajectory(np.array([(1.0, 1.0), (4.0, 1.2), (6.5, 2.6), (4.0, 3.2)]))
    with ResultBag(tmp_path / 'bag') as bag:
        bag.mount(100.0, Pose(0.1, 0.0, 0.0), 0.3)
        for stamp, pose, told in zip(100.0 + stamps, poses, fake_odometry(poses)):
            bag.odometry(stamp, told)
            scan = fake_scan(fake_room(), pose, stamp, beams=541, field_of_view=1.5 * PI,
                             T_base_laser=Pose(0.1, 0.0, 0.0))
            seen = cloud(replace(scan, T_base_laser=Pose()), 30.0).outline
            rows = np.zeros((np.count_nonzero(seen.hit), 7), np.float32)
            rows[:, :2] = seen.ends[seen.hit]
            bag.clusters('/points', stamp, 'laser', rows)
    log = open_log(tmp_path / 'bag')
    assert (log.scan_topic, log.T_base_laser) == ('/points', pytest.approx(Pose(0.1, 0.0, 0.0)))
    run = run_robot(log)
    assert np.hypot(*(run.poses[-1] - between(poses[0], poses)[-1])[:2]) < 0.1
    assert run.grid.occupied.sum() > 200


def test_two_lasers_on_one_robot_are_both_used(tmp_path: Path) -> None:
    """180 degrees to the front and to the back, ten scans a second each, 0.05 s apart."""
    mounts = {'front': Pose(0.2, 0.0, 0.0), 'back': Pose(-0.2, 0.0, 3.0)}
    stamps, poses = fake_trajectory(
        np.array([(1.0, 1.0), (4.0, 1.2), (6.5, 2.6), (4.0, 3.2), (1.5, 4.5)]), rate=20.0)
    odometry = fake_odometry(poses, (0.01, 0.01))
    with BagWriter(tmp_path / 'bag') as bag:
        for name, mount in mounts.items():
            bag.transform('/tf_static', 100.0, 'base_link', f'{name}_laser',
                          (*mount[:2], 0.2), quaternion(mount.theta))
        for number, (stamp, pose) in enumerate(zip(stamps, poses)):
            bag.odometry(100.0 + stamp, odometry[number])
            name = ('front', 'back')[number % 2]
            bag.frames = ('odom', 'base_link', f'{name}_laser')
            bag.scan(fake_scan(fake_room(), pose, 100.0 + stamp, beams=181, field_of_view=PI,
                               T_base_laser=mounts[name]), topic=f'/{name}/scan')
    log = open_log(tmp_path / 'bag')
    assert {topic: mounts.first.T_base_laser for topic, mounts in log.lasers.items()} == {
        '/front/scan': pytest.approx(mounts['front']), '/back/scan': pytest.approx(mounts['back'])}
    run = run_robot(log)
    assert len(run.milliseconds) == len(stamps)
    assert not run.counters.get('scan_stamps_backward')
    truth = between(poses[0], poses)[-1]
    assert np.hypot(*(run.poses[-1] - truth)[:2]) < 0.1
    assert run.grid.occupied.sum() > 200
