# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of every kind give the same scans, odometry and laser mount."""

from pathlib import Path
import time
from types import SimpleNamespace

from helpers import need_data, write_fake_bag
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.io.bags.log import BagError, BagOptions, Log, open_log
from somfusion_ros.io.bags.odometry import Encoders
from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan

LEVEL = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)
QUARTER = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
RANGES = np.array([1.0, 2.0, 0.0, np.inf, 5.0])


def scan_at(stamp: float) -> Scan:
    """Make a scan of five beams."""
    return Scan(stamp, RANGES, -0.2, 0.1, 0.05, 4.0)


def scans(log: Log) -> list[Scan]:
    """Read the scans of a log."""
    return [record for record in log if isinstance(record, Scan)]


def odometry(log: Log) -> list[Odometry]:
    """Read the odometry of a log."""
    return [record for record in log if isinstance(record, Odometry)]


def write_small(folder: Path, stamps: Array, chain: tuple = (), frames: tuple = ()) -> Path:
    """Write a bag with a scan and odometry per stamp, and a chain of static transforms."""
    with BagWriter(folder, frames=frames or ('odom', 'base_link', 'laser')) as bag:
        for parent, child, translation, quaternion in chain:
            bag.transform('/tf_static', 1.0, parent, child, translation, quaternion)
        for number, stamp in enumerate(stamps):
            bag.recorded = 1000.0 + 0.1 * number
            bag.odometry(stamp, (0.1 * number, 0.0, 0.02 * number), (1.0, 0.0, 0.2))
            bag.scan(scan_at(stamp))
    return folder


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_reads_what_was_written(tmp_path: Path, storage: str) -> None:
    poses = write_fake_bag(tmp_path / 'bag', storage=storage, every=2)
    log = open_log(tmp_path / 'bag')
    records = list(log)
    assert (log.scan_topic, log.odometry_topic, log.odometry_source) == ('/scan', '/odom', 'odom')
    assert log.scan_count == len(scans(log)) == (len(poses) + 1) // 2
    assert len(odometry(log)) == len(poses)
    assert log.T_base_laser == Pose(0.1, 0.0, 0.0)
    stamps = [record.stamp for record in records]
    assert stamps == sorted(stamps)
    assert log.duration == pytest.approx(stamps[-1] - stamps[0])


def test_a_single_file_and_the_folder_above_are_bags_too(tmp_path: Path) -> None:
    write_fake_bag(tmp_path / 'bag', every=5)
    file = next((tmp_path / 'bag').glob('*.mcap'))
    count = len(scans(open_log(tmp_path / 'bag')))
    assert len(scans(open_log(tmp_path))) == len(scans(open_log(file))) == count
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert len(scans(open_log(tmp_path / 'bag'))) == count


def test_ranges_come_as_they_were_recorded(tmp_path: Path) -> None:
    log = open_log(write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1)))
    scan = scans(log)[0]
    assert np.array_equal(scan.ranges, RANGES)
    assert scan.range_max == 4.0
    assert scan.angle_min == pytest.approx(-0.2)
    assert odometry(log)[3].pose == pytest.approx([0.3, 0.0, 0.06])
    assert odometry(log)[3].twist == pytest.approx([1.0, 0.0, 0.2])


def write_rosbag1(file: Path, numbers: range) -> None:
    """Write a bag of ROS 1 with a scan and odometry a second."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = store.types
    time_type, header = kind['builtin_interfaces/msg/Time'], kind['std_msgs/msg/Header']
    scan_type = 'sensor_msgs/msg/LaserScan'
    odom_type = 'nav_msgs/msg/Odometry'
    point, turn = kind['geometry_msgs/msg/Point'], kind['geometry_msgs/msg/Quaternion']
    vector, pose = kind['geometry_msgs/msg/Vector3'], kind['geometry_msgs/msg/Pose']
    with Writer1(file) as bag:
        topics = {t: bag.add_connection(f'/{n}', t, typestore=store)
                  for n, t in (('base_scan', scan_type), ('odom', odom_type))}
        for number in numbers:
            head = header(number, time_type(10 + number, 0), '/laser')
            scan = kind[scan_type](head, -0.2, 0.2, 0.1, 0.0, 0.1, 0.05, 4.0,
                                   RANGES.astype(np.float32), np.zeros(0, np.float32))
            here = kind['geometry_msgs/msg/PoseWithCovariance'](
                pose(point(float(number), 0.0, 0.0), turn(*LEVEL)), np.zeros(36))
            twist = kind['geometry_msgs/msg/TwistWithCovariance'](
                kind['geometry_msgs/msg/Twist'](vector(1.0, 0.0, 0.0), vector(0.0, 0.0, 0.0)),
                np.zeros(36))
            head = header(number, time_type(10 + number, 0), '/odom')
            odom = kind[odom_type](head, '/base_link', here, twist)
            for name, message in ((scan_type, scan), (odom_type, odom)):
                bag.write(topics[name], (10 + number) * 10 ** 9,
                          store.serialize_ros1(message, name))


def test_reads_rosbag1(tmp_path: Path) -> None:
    write_rosbag1(tmp_path / 'log.bag', range(5))
    log = open_log(tmp_path / 'log.bag')
    assert log.scan_topic == '/base_scan'
    assert [scan.stamp for scan in scans(log)] == [10.0, 11.0, 12.0, 13.0, 14.0]
    assert odometry(log)[2].pose == pytest.approx([2.0, 0.0, 0.0])
    assert 'laser is taken to sit in base_link' in log.notes[0]


def test_messages_of_rosbag1_come_as_those_of_ros_2(tmp_path: Path) -> None:
    """A header of ROS 1 has a number more; some converters leave it out of their definitions."""
    write_rosbag1(tmp_path / 'log.bag', range(5))
    store = get_typestore(Stores.ROS2_JAZZY)
    with BagReader(tmp_path / 'log.bag') as bag:
        played = list(bag.serialized({'/base_scan'}))
        assert bag.span == (10 * 10 ** 9, 14 * 10 ** 9 + 1)
    assert [time for _, time, _ in played] == [n * 10 ** 9 for n in range(10, 15)]
    assert {topic for topic, _, _ in played} == {'/base_scan'}
    scan = store.deserialize_cdr(played[3][2], 'sensor_msgs/msg/LaserScan')
    assert (scan.header.stamp.sec, scan.header.frame_id) == (13, '/laser')
    assert np.array_equal(scan.ranges, RANGES.astype(np.float32))


def test_a_split_rosbag1_is_one_log(tmp_path: Path) -> None:
    """Recorded by `rosbag record --split`: the tenth part comes after the ninth."""
    for part in range(11):
        write_rosbag1(tmp_path / f'run_{part}.bag', range(3 * part, 3 * part + 3))
    log = open_log(tmp_path)
    assert [scan.stamp for scan in scans(log)] == [10.0 + number for number in range(33)]
    assert log.scan_count == len(odometry(log)) == 33


def test_composes_the_chain_to_the_laser(tmp_path: Path) -> None:
    chain = [('base_link', 'mast', (0.2, 0.0, 0.5), QUARTER),
             ('mast', '/laser', (0.1, 0.0, 0.1), QUARTER)]
    log = open_log(write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1), chain))
    assert log.T_base_laser[:2] == pytest.approx((0.2, 0.1))
    assert abs(log.T_base_laser.theta) == pytest.approx(np.pi)
    assert not log.notes


def test_chain_may_run_through_a_parent_of_the_base(tmp_path: Path) -> None:
    chain = [('base_footprint', 'base_link', (0.0, 0.0, 0.1), LEVEL),
             ('base_footprint', 'laser', (0.3, 0.1, 0.2), LEVEL)]
    log = open_log(write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1), chain))
    assert log.T_base_laser == pytest.approx((0.3, 0.1, 0.0))


def test_usual_names_of_the_base_stand_in_for_one_another(tmp_path: Path) -> None:
    log = open_log(write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1),
                               [('base_link', 'laser', (0.3, 0.1, 0.2), LEVEL)],
                               ('odom', 'base_footprint', 'laser')))
    assert log.T_base_laser == pytest.approx((0.3, 0.1, 0.0))
    assert not log.notes


def test_a_laser_upside_down_turns_the_other_way(tmp_path: Path) -> None:
    """A beam at angle a of a laser rolled by 180 degrees points to -a of the base."""
    chain = [('base_link', 'laser', (0.1, 0.0, 0.2), UPSIDE_DOWN)]
    log = open_log(write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1), chain))
    scan = scans(log)[0]
    assert scan.angle_min == pytest.approx(0.2)
    assert scan.angle_increment == pytest.approx(-0.1)
    assert scan.T_base_laser == pytest.approx((0.1, 0.0, 0.0))


def test_a_tilted_laser_is_refused(tmp_path: Path) -> None:
    tilted = (0.0, np.sin(0.2), 0.0, np.cos(0.2))
    folder = write_small(tmp_path / 'bag', np.arange(1.0, 2.0, 0.1),
                         [('base_link', 'laser', (0.0, 0.0, 0.0), tilted)])
    with pytest.raises(BagError, match='tilted by 23 deg'):
        open_log(folder)
    assert open_log(folder, BagOptions(laser_pose=Pose(0.4, 0.0, 0.0))).T_base_laser.x == 0.4


def test_records_written_late_are_put_in_order(tmp_path: Path) -> None:
    stamps = np.arange(1.0, 6.0, 0.1)
    late = stamps.copy()
    late[20:24] = late[20:24][::-1]
    log = open_log(write_small(tmp_path / 'bag', late))
    assert [scan.stamp for scan in scans(log)] == pytest.approx(stamps)


def test_a_leap_back_in_time_is_not_hidden(tmp_path: Path) -> None:
    stamps = np.concatenate([np.arange(100.0, 110.0, 0.5), np.arange(50.0, 60.0, 0.5)])
    log = open_log(write_small(tmp_path / 'bag', stamps))
    read = np.array([scan.stamp for scan in scans(log)])
    assert len(read) == len(stamps)
    assert (np.diff(read) < 0).any()


def test_odometry_that_is_not_finite_is_counted(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number, x in enumerate([0.0, np.nan, 0.2, np.inf]):
            bag.odometry(1.0 + number, (x, 0.0, 0.0))
            bag.scan(scan_at(1.0 + number))
    log = open_log(tmp_path / 'bag')
    assert len(odometry(log)) == 2
    assert log.counters == {'odometry_not_finite': 2}


def test_odometry_from_tf(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(5):
            bag.transform('/tf', 1.0 + number, 'odom', 'base_link', (0.5 * number, 0, 0), LEVEL)
            bag.transform('/tf', 1.0 + number, 'base_link', 'wheel', (0, 0, 0), LEVEL)
            bag.scan(scan_at(1.0 + number))
    log = open_log(tmp_path / 'bag')
    assert log.odometry_source == 'tf'
    found = odometry(log)
    assert [one.pose[0] for one in found] == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert found[3].twist == pytest.approx([0.5, 0.0, 0.0])


def test_odometry_from_encoders(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(11):
            bag.wheels(1.0 + 0.1 * number, (5.0 + number, 7.0 + number))
            bag.scan(scan_at(1.0 + 0.1 * number))
    with pytest.raises(BagError, match='give --wheel-radius and --wheel-separation'):
        open_log(tmp_path / 'bag')
    log = open_log(tmp_path / 'bag', BagOptions(wheel_radius=0.1, wheel_separation=0.4))
    found = odometry(log)
    assert log.odometry_source == 'encoders'
    assert found[-1].pose == pytest.approx([1.0, 0.0, 0.0])
    assert (np.diff([one.slip[0] for one in found]) > 0.0).all(), 'each metre adds slip'
    assert found[-1].slip[1] == 0.0, 'both wheels went as far'


def test_a_choice_between_topics_is_not_guessed(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(3):
            bag.odometry(1.0 + number, (0.0, 0.0, 0.0))
            for topic in ('/front', '/rear'):
                bag.scan(scan_at(1.0 + number), topic=topic)
    with pytest.raises(BagError, match='/front, /rear; name one by --scan-topic'):
        open_log(tmp_path / 'bag')
    assert open_log(tmp_path / 'bag', BagOptions(scan_topic='rear')).scan_topic == '/rear'
    with pytest.raises(BagError, match='on topic /side .found: /front, /rear'):
        open_log(tmp_path / 'bag', BagOptions(scan_topic='/side'))


def test_real_log_with_encoders() -> None:
    folder = need_data('logs', 'mines_exp1')
    log = open_log(folder, BagOptions(odometry_source='encoders', wheel_radius=0.077,
                                      wheel_separation=0.33))
    given = open_log(folder)
    assert given.T_base_laser == pytest.approx((0.145, 0.0, 0.0))
    assert len(odometry(log)) == len(odometry(given)) == 756
    lengths = [np.hypot(*np.diff([o.pose[:2] for o in odometry(one)], axis=0).T).sum()
               for one in (log, given)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.05)


def test_real_log_is_read_fast() -> None:
    folder = need_data('logs', 'intel')
    started = time.perf_counter()
    assert len(scans(open_log(folder))) == 5327
    assert time.perf_counter() - started < 10.0


def test_a_joint_that_nobody_measures_takes_no_wheel_along() -> None:
    """An arm among the joints, say, whose positions are NaN until it is switched on."""
    encoders = Encoders(BagOptions(wheel_radius=0.1, wheel_separation=0.4), Path('bag'))
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0))
    for arm, left, heard in ((np.nan, 1.0, True), (0.0, np.nan, False), (0.0, np.inf, False)):
        message = SimpleNamespace(header=header, position=[arm, left, 1.0],
                                  name=['arm', 'left_wheel_joint', 'right_wheel_joint'])
        assert (encoders(message, 0.0) is not None) == heard
