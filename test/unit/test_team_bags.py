# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several robots in one bag, under the names that people give to topics and frames."""

from dataclasses import dataclass
import json
from pathlib import Path

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
import numpy as np
import pytest
from somfusion_ros.cli.main import main
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.io.bags.log import BagError, BagOptions, open_log, robots_in
from somfusion_ros.io.bags.writer import BagWriter, quaternion
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan

pytestmark = pytest.mark.slow

WAYS = {'robot1': [(1.0, 1.0), (4.0, 1.2), (6.5, 2.6), (4.0, 3.2), (1.5, 4.5)],
        'robot2': [(6.8, 2.8), (4.0, 3.0), (1.5, 4.6), (1.2, 2.0), (3.5, 1.0)]}
MOUNTS = {'robot1': Pose(0.1, 0.0, 0.0), 'robot2': Pose(-0.2, 0.1, float(np.pi / 2))}


@dataclass(frozen=True)
class Style:
    """How a team spells its names: {} is the robot's name."""

    odometry: str            # child frame of the odometry
    scan: str                # frame of the scans
    base: str                # frame of the robot in TF
    laser: str               # frame of the laser in TF
    tf: str = ''             # namespace of /tf and /tf_static
    odom: str = 'odom'       # frame of the odometry in TF
    in_tf: bool = False      # odometry only in TF


STYLES = {
    'a tree of its own': Style('base_link', 'laser', 'base_link', 'laser', '/{}'),
    'one tree, prefixes': Style('{}/base_link', '{}/laser', '{}/base_link', '{}/laser'),
    'no prefix in the messages': Style('base_link', 'laser', '{}/base_link', '{}/laser'),
    'no prefix in the odometry': Style('base_footprint', '{}/laser', '{}/base_link', '{}/laser'),
    'no prefix in TF': Style('{}/base_link', '{}/laser', 'base_link', 'laser', '/{}'),
    'underscores': Style('{}_base_link', '{}_laser', '{}_base_link', '{}_laser'),
    'odometry in one tree': Style('', '{}/laser', '{}/base_link', '{}/laser', '', '{}/odom', True),
    'odometry in its own tree': Style('', 'laser', 'base_footprint', 'laser', '/{}', 'odom', True),
    'odometry with underscores': Style('', '{}_laser', '{}_base_link', '{}_laser', '', '{}_odom',
                                       True),
    'odometry of another filter': Style('', '{}/laser', '{}/base_link', '{}/laser', '',
                                        '{}/odom_combined', True),
}


def write_team(folder: Path, style: Style, every: int = 2) -> dict[str, Array]:
    """Write both robots' drives into one bag; return their true poses."""
    truth = {}
    with BagWriter(folder) as bag:
        for name, mount in MOUNTS.items():
            bag.transform(f'{style.tf.format(name)}/tf_static', 100.0, style.base.format(name),
                          style.laser.format(name), (*mount[:2], 0.2), quaternion(mount.theta))
        drives = {name: fake_trajectory(np.array(way)) for name, way in WAYS.items()}
        for number in range(min(len(stamps) for stamps, _ in drives.values())):
            for name, (stamps, poses) in drives.items():
                truth[name], stamp = poses, 100.0 + stamps[number]
                drifted = fake_odometry(poses[:number + 1], (0.01, 0.01))[-1]
                bag.namespace = name
                bag.frames = (style.odom.format(name), style.odometry.format(name),
                              style.scan.format(name))
                if style.in_tf:
                    bag.transform(f'{style.tf.format(name)}/tf', stamp, style.odom.format(name),
                                  style.base.format(name), (*drifted[:2], 0.0),
                                  quaternion(drifted[2]))
                else:
                    bag.odometry(stamp, drifted)
                if number % every == 0:
                    bag.scan(fake_scan(fake_room(), poses[number], stamp,
                                       T_base_laser=MOUNTS[name]))
    return truth


@pytest.mark.parametrize('name', STYLES)
def test_every_robot_gets_its_own_mount_and_odometry(name: str, tmp_path: Path) -> None:
    """Before, robot2 got the mount of robot1, silently, and was 5 m off."""
    style = STYLES[name]
    truth = write_team(tmp_path / 'bag', style, every=10)
    assert robots_in(tmp_path / 'bag') == ['robot1', 'robot2']
    for robot, mount in MOUNTS.items():
        log = open_log(tmp_path / 'bag', BagOptions(namespace=robot))
        assert log.scan_topic == f'/{robot}/scan'
        assert not log.notes
        assert log.T_base_laser == pytest.approx(mount, abs=1e-6)
        assert log.odometry_source == ('tf' if style.in_tf else 'odom')
        ends = [record.pose for record in log if isinstance(record, Odometry)]
        whole = between(truth[robot][0], truth[robot][len(ends) - 1])
        assert np.hypot(*(ends[-1] - whole)[:2]) < 0.5


def test_a_team_in_one_bag_is_replayed_and_merged(tmp_path: Path) -> None:
    truth = write_team(tmp_path / 'bag', STYLES['one tree, prefixes'])
    for arguments in ([], ['--namespaces', 'robot1', '/robot2']):
        assert main(['replay', str(tmp_path / 'bag'), *arguments, '--no-report', '--jobs', '1',
                     '--output', str(tmp_path / 'out')]) == 0
        record = json.loads((tmp_path / 'out' / 'result.json').read_text())
        found = [record['transforms']['robot2'][key] for key in ('x', 'y', 'theta')]
        distance, angle = pose_error(np.array(found),
                                     between(truth['robot1'][0], truth['robot2'][0]))
        assert distance < 0.15
        assert angle < np.radians(2.0)
        assert record['robots']['robot2']['namespace'] == 'robot2'


def test_one_robot_of_a_team(tmp_path: Path) -> None:
    write_team(tmp_path / 'bag', STYLES['a tree of its own'], every=10)
    assert main(['replay', str(tmp_path / 'bag'), '--namespaces', 'robot2', '--no-report',
                 '--output', str(tmp_path / 'out')]) == 0
    with pytest.raises(BagError, match='no laser scans in namespace robot3'):
        open_log(tmp_path / 'bag', BagOptions(namespace='robot3'))


def write_one(folder: Path, chain: list[tuple[str, str, float]], scan: str = 'laser',
              base: str = 'base_link', scans: int = 5) -> Path:
    """Write a bag of one robot with transforms (parent, child, x) on tf_static in their order."""
    with BagWriter(folder, frames=('odom', base, scan)) as bag:
        for number, (parent, child, x) in enumerate(chain):
            bag.transform('/tf_static', 1.0 + 0.1 * number, parent, child, (x, 0.0, 0.0),
                          quaternion(0.0))
        for number in range(scans):
            bag.odometry(1.0 + 0.1 * number, (0.0, 0.0, 0.0))
            bag.scan(fake_scan(fake_room(), np.array((1.0, 1.0, 0.0)), 1.0 + 0.1 * number))
    return folder


@pytest.mark.parametrize(('scan', 'base', 'tf_base', 'tf_laser'), [
    ('robot1/laser', 'robot1/base_link', 'base_link', 'laser'),
    ('laser', 'base_link', 'robot1/base_link', 'robot1/laser'),
    ('/robot1/laser', 'base_link', 'robot1/base_footprint', 'robot1/laser'),
    ('laser', 'r7/base_footprint', 'base_link', 'laser'),
    ('laser', 'r7/base_footprint', 'r7/base_link', 'r7/laser')])
def test_a_prefix_in_one_place_only(scan: str, base: str, tf_base: str, tf_laser: str,
                                    tmp_path: Path) -> None:
    log = open_log(write_one(tmp_path / 'bag', [(tf_base, tf_laser, 0.3)], scan, base))
    assert log.T_base_laser.x == pytest.approx(0.3)
    assert not log.notes


def test_the_mount_of_another_robot_is_never_taken(tmp_path: Path) -> None:
    folder = write_one(tmp_path / 'bag', [('robot1/base_link', 'robot1/laser', 0.3)],
                       'robot2/laser', 'robot2/base_link')
    log = open_log(folder)
    assert log.T_base_laser == Pose()
    assert "no transform from robot2/base_link to 'robot2/laser'" in log.notes[0]


def test_a_laser_under_a_similar_name_is_used_and_said(tmp_path: Path) -> None:
    log = open_log(write_one(tmp_path / 'a', [('base_link', 'laser_link', 0.3)], 'base_laser'))
    assert log.T_base_laser.x == pytest.approx(0.3)
    assert "that to 'laser_link' is used" in log.notes[0]
    two = [('base_link', 'laser_front', 0.3), ('base_link', 'laser_back', -0.3)]
    with pytest.raises(BagError, match='laser_back, laser_front: give --laser-pose'):
        open_log(write_one(tmp_path / 'b', two, 'laser'))


def test_a_laser_pose_of_zeros_is_one(tmp_path: Path) -> None:
    folder = write_one(tmp_path / 'bag', [('base_link', 'laser', 0.3)])
    assert open_log(folder, BagOptions(laser_pose=Pose())).T_base_laser == Pose()


def test_a_tf_static_that_is_corrected_later_is_taken_and_said(tmp_path: Path) -> None:
    wrong, right = ('base_link', 'laser', 0.9), ('base_link', 'laser', 0.3)
    log = open_log(write_one(tmp_path / 'a', [wrong, right]))
    assert log.T_base_laser.x == pytest.approx(0.3)
    assert "the mount of 'laser' on tf_static was corrected at " in log.notes[0]
    again = open_log(write_one(tmp_path / 'b', [right, right]))
    assert not again.notes, 'a transform that is repeated is not corrected'


def test_a_mount_that_is_corrected_holds_from_then_on(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.mount(1.0, Pose(0.9, 0.0, 0.0))
        for number in range(10):
            if number == 6:
                bag.mount(1.55, Pose(0.3, 0.0, 0.0))
            bag.odometry(1.0 + 0.1 * number, (0.0, 0.0, 0.0))
            bag.scan(Scan(1.0 + 0.1 * number, np.ones(5), -0.2, 0.1, 0.05, 4.0))
    log = open_log(tmp_path / 'bag')
    told = [record.T_base_laser.x for record in log if isinstance(record, Scan)]
    assert told == pytest.approx([0.9] * 6 + [0.3] * 4)
    assert len(log.notes) == 1


def test_odometry_in_tf_after_thousands_of_other_transforms(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(6000):
            bag.transform('/tf', 1.0 + 1e-3 * number, 'base_link', f'wheel{number % 4}',
                          (0.1, 0.0, 0.0), quaternion(0.0))
        for number in range(20):
            stamp = 7.0 + 0.1 * number
            bag.transform('/tf', stamp, 'odom_combined', 'base_footprint', (0.02 * number, 0, 0),
                          quaternion(0.0))
            bag.scan(fake_scan(fake_room(), np.array((1.0, 1.0, 0.0)), stamp))
    log = open_log(tmp_path / 'bag')
    assert log.odometry.frames == ('odom_combined', 'base_footprint')
    assert len([r for r in log if isinstance(r, Odometry)]) == 20
