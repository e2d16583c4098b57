# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The angles of a LaserScan checked by one another, and two lasers on one robot."""

from pathlib import Path
from types import SimpleNamespace

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory
import numpy as np
import pytest
from somfusion_ros.geometry import between, Pose
from somfusion_ros.io.bags.log import BagError, open_log
from somfusion_ros.io.bags.writer import BagWriter, quaternion
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.io.scan_messages import angles, scan_from
from somfusion_ros.offline.result_bag import ResultBag
from somfusion_ros.offline.robot_run import run_robot

PI, DEGREE = np.pi, np.pi / 180.0


@pytest.mark.parametrize(('told', 'meant'), [
    ((-PI, PI, -DEGREE), (-PI, DEGREE)),                       # a mirrored map
    ((PI, -PI, DEGREE), (PI, -DEGREE)),                        # turned by the driver
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


def test_a_bag_with_clouds_only_names_the_remedy(tmp_path: Path) -> None:
    with ResultBag(tmp_path / 'bag') as bag:
        bag.clusters('/points', 1.0, 'laser', np.zeros((3, 7), np.float32))
    with pytest.raises(BagError, match='PointCloud2 on /points: .*pointcloud_to_laserscan'):
        open_log(tmp_path / 'bag')


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
    assert {topic: mount.T_base_laser for topic, mount in log.lasers.items()} == {
        '/front/scan': pytest.approx(mounts['front']), '/back/scan': pytest.approx(mounts['back'])}
    run = run_robot(log)
    assert len(run.milliseconds) == len(stamps)
    assert not run.counters.get('scan_stamps_backward')
    truth = between(poses[0], poses)[-1]
    assert np.hypot(*(run.poses[-1] - truth)[:2]) < 0.1
    assert run.grid.occupied.sum() > 200
