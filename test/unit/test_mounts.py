# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the lasers of a bag sit, where that is told twice, of another laser, or not at all."""

from pathlib import Path

import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags.log import BagError, BagOptions, Log, open_log
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.offline.fault_log import FaultLog
from somfusion_ros.slam.scan import Scan

LEVEL, UPSIDE_DOWN = (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)


def write_lasers(folder: Path, topics: dict[str, str], mounts: dict[str, tuple] | None = None,
                 scans: int = 3, stamped: bool = True) -> Path:
    """Write scans of lasers (topic: frame), all with the same stamps; mounts: x and quaternion."""
    with BagWriter(folder) as bag:
        for frame, (x, rotation) in (mounts or {}).items():
            bag.transform('/tf_static', 1.0, 'base_link', frame, (x, 0.0, 0.3), rotation)
        for number in range(scans):
            bag.recorded = 1.0 + 0.1 * number
            stamp = bag.recorded if stamped else 0.0
            bag.odometry(bag.recorded, (0.1 * number, 0.0, 0.0))
            for topic, frame in topics.items():
                bag.frames = ('odom', 'base_link', frame)
                bag.scan(Scan(stamp, np.full(5, 2.0), -0.2, 0.1, 0.05, 4.0), topic=topic)
    return folder


def scans_of(log: Log) -> list[Scan]:
    """Read the scans of a log."""
    return [record for record in log if isinstance(record, Scan)]


def test_scans_of_two_lasers_with_one_stamp_are_all_used(tmp_path: Path) -> None:
    """As a simulator stamps them, and lasers that are triggered together."""
    bag = write_lasers(tmp_path / 'bag', {'/front': 'laser_f', '/rear': 'laser_r'},
                       {'laser_f': (0.2, LEVEL), 'laser_r': (-0.2, LEVEL)})
    read = scans_of(open_log(bag))
    stamps = [scan.stamp for scan in read]
    assert len(read) == 6 and len(set(stamps)) == 6
    assert stamps == pytest.approx([1.0, 1.0, 1.1, 1.1, 1.2, 1.2], abs=1e-5)
    assert [scan.T_base_laser.x for scan in read[:2]] == [0.2, -0.2]


def test_the_mount_of_one_laser_is_not_taken_for_another(tmp_path: Path) -> None:
    """Names of frames of a robot's lasers are spelt alike."""
    lasers = {'/front': 'laser_f', '/rear': 'laser_r'}
    bag = write_lasers(tmp_path / 'bag', lasers, {'laser_f': (0.2, LEVEL)})
    with pytest.raises(BagError, match='name one by --scan-topic, or record where each laser'):
        open_log(bag)
    log = open_log(bag, BagOptions(scan_topic='/rear'))
    assert log.T_base_laser == Pose()
    assert any("no transform from base_link to 'laser_r'" in note for note in log.notes)


def test_one_given_mount_is_not_that_of_two_lasers(tmp_path: Path) -> None:
    bag = write_lasers(tmp_path / 'bag', {'/front': 'laser_f', '/rear': 'laser_r'})
    given = Pose(0.2, 0.0, 0.0)
    with pytest.raises(BagError, match='is the mount of one: name it by --scan-topic'):
        open_log(bag, BagOptions(laser_pose=given))
    assert open_log(bag, BagOptions(laser_pose=given, scan_topic='/rear')).T_base_laser == given


@pytest.mark.parametrize(('given', 'rotation', 'words'), [
    ((0.2, 0.0, 0.0), LEVEL, ''), ((0.21, 0.0, 0.01), LEVEL, ''),
    ((0.5, 0.0, 0.0), LEVEL, "TF has 'laser' at 0.2, 0, 0: leave laser_pose out if TF is right"),
    ((0.2, 0.0, 3.1), LEVEL, "TF has 'laser' at 0.2, 0, 0"),
    ((0.2, 0.0, 0.0), UPSIDE_DOWN, 'upside down, which laser_pose cannot say')])
def test_a_given_mount_that_differs_from_the_bags_is_said(
        tmp_path: Path, given: tuple, rotation: tuple, words: str) -> None:
    bag = write_lasers(tmp_path / 'bag', {'/scan': 'laser'}, {'laser': (0.2, rotation)})
    notes = open_log(bag, BagOptions(laser_pose=Pose(*given))).notes
    assert (words in notes[0]) if words else not notes


def test_a_mount_upside_down_differs_whatever_its_place() -> None:
    level = Mount(Pose(0.1, 0.0, 0.0))
    assert not level.difference(level, 'laser')
    assert level.difference(Mount(Pose(0.1, 0.0, 0.0), upside_down=True), 'laser')


def test_stamps_of_zero_are_counted_in_a_replay_too(tmp_path: Path) -> None:
    log = open_log(write_lasers(tmp_path / 'bag', {'/scan': 'laser'}, stamped=False))
    assert [scan.stamp for scan in scans_of(log)] == pytest.approx([1.0, 1.1, 1.2])
    assert log.counters == {'messages_without_stamp': 3}
    assert any('/scan has stamps of 0' in note for note in log.notes)


def test_a_bag_without_scans_tells_what_it_holds(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'empty'):
        pass
    with pytest.raises(BagError, match='no laser scans .the bag holds no messages.'):
        open_log(tmp_path / 'empty')
    with BagWriter(tmp_path / 'odom') as bag:
        bag.odometry(1.0, (0.0, 0.0, 0.0))
    with pytest.raises(BagError, match='no laser scans .the bag holds /odom.'):
        open_log(tmp_path / 'odom')


def test_what_is_usual_of_a_drive_is_said_where_it_is_much() -> None:
    faults = FaultLog()
    for _ in range(19):
        faults('odometry_jumps', 'too fast')
        faults('lost', 'until it is found in the map that was given')
    assert not faults.notes(100)
    assert faults.notes(50) == ['odometry_jumps: too fast (19 times)']
