# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The smaller parts of the nodes: diagnostics, drawing, the player."""

from dataclasses import replace
from functools import partial
import logging
from pathlib import Path
import shutil
import sys
from types import SimpleNamespace
from typing import Any

from helpers import fake_grid, fake_room, fake_scan, need_data, need_ros, write_fake_bag
import numpy as np
import pytest
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Pose
from somfusion_ros.team.config import TeamConfig

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from rclpy.clock import Clock  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import Imu, JointState, LaserScan, PointCloud2  # noqa: E402
from somfusion_ros.fusion.learning import learn  # noqa: E402
from somfusion_ros.io.bags.writer import BagWriter  # noqa: E402
from somfusion_ros.io.cluster_rows import cluster_rows  # noqa: E402
from somfusion_ros.node_config import SlamNodeConfig  # noqa: E402
from somfusion_ros.offline.beginning import Beginning  # noqa: E402
from somfusion_ros.offline.result_bag import ResultBag  # noqa: E402
from somfusion_ros.report.watch_view import HeardTeam  # noqa: E402
from somfusion_ros.ros.apps import player, player_options  # noqa: E402
from somfusion_ros.ros.apps.recording import ODOMETRY_IN_TF, Recording  # noqa: E402
from somfusion_ros.ros.apps.watch import WatchNode  # noqa: E402
from somfusion_ros.ros.common.conversions import transform_message  # noqa: E402
from somfusion_ros.ros.common.diagnostics import Faults, status, text  # noqa: E402
from somfusion_ros.ros.common.optional_types import message_type  # noqa: E402
from somfusion_ros.ros.common.peers import find_robots  # noqa: E402
from somfusion_ros.ros.common.tf import Broadcaster, Mounts  # noqa: E402
from somfusion_ros.ros.fusion.frames import Frames  # noqa: E402
from somfusion_ros.ros.fusion.markers import team_markers  # noqa: E402
from somfusion_ros.ros.fusion.publisher import FusionPublisher  # noqa: E402
from somfusion_ros.ros.fusion.status import fusion_statuses  # noqa: E402
from somfusion_ros.ros.fusion.view_link import ViewLink  # noqa: E402
from somfusion_ros.ros.slam.joint_path import JointPath  # noqa: E402
from somfusion_ros.ros.slam.node import SlamNode  # noqa: E402
from somfusion_ros.ros.slam.odometry_input import OdometryInput  # noqa: E402
from somfusion_ros.ros.slam.pipeline import Pipeline  # noqa: E402
from somfusion_ros.ros.slam.status import Last  # noqa: E402
from somfusion_ros.slam.config import SlamConfig  # noqa: E402
from somfusion_ros.slam.epoch import Epoch  # noqa: E402
from somfusion_ros.slam.session import Session  # noqa: E402
from somfusion_ros.team.constraint import MapConstraint  # noqa: E402
from somfusion_ros.team.heard import Heard, TimedPose  # noqa: E402
from somfusion_ros.team.session import FusionSession  # noqa: E402
from somfusion_ros.team.shared_map import SharedMap  # noqa: E402
from somfusion_ros.team.state_codec import TeamState  # noqa: E402
from std_msgs.msg import UInt8MultiArray  # noqa: E402

TFMessage: Any = message_type('tf2_msgs.msg', 'TFMessage')


class Log:
    """Keeps what a node would log."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.info = self.warning = lambda line, **_: self.lines.append(line)


def test_without_tf_the_mount_comes_from_the_parameter_and_nothing_is_sent(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    log = Log()
    node = SimpleNamespace(get_logger=lambda: log, get_namespace=lambda: '/')
    broadcaster = Broadcaster(node)
    assert not broadcaster.available
    broadcaster.send(['one'])
    for given in (Pose(), Pose(0.1, 0.0, 0.2)):
        mounts = Mounts(node, given, lambda kind, reason='': None)
        assert mounts.find('base_link', 'laser').T_base_laser == pytest.approx(given)
    assert all('without TF' in line for line in log.lines)
    assert log.lines


def test_an_imu_is_heard_beside_any_odometry() -> None:
    for source in ('odom', 'none'):
        heard: dict[str, Any] = {}
        rates: list[tuple[float, float]] = []
        node = SimpleNamespace(
            get_clock=Clock, create_subscription=lambda kind, topic, take, *_, **__: (
                heard.update({topic: take}) or SimpleNamespace(topic_name=topic)))
        OdometryInput(node, SlamNodeConfig(odometry_source=source), print,
                      lambda *told: rates.append(told), print)
        message = Imu()
        message.header.stamp.sec, message.angular_velocity.z = 7, 0.5
        heard['imu'](message)
        assert rates == [(7.0, 0.5)]


def test_wheels_of_another_name_are_told_until_the_right_ones_come() -> None:
    heard: dict[str, Any] = {}
    counted: list[str] = []
    node = SimpleNamespace(
        get_clock=Clock, create_subscription=lambda kind, topic, take, *_, **__: (
            heard.update({topic: take}) or SimpleNamespace(topic_name=topic)))
    OdometryInput(node, SlamNodeConfig(odometry_source='encoders'), lambda *_: None, print,
                  lambda kind, reason, patience=0.0: counted.append(f'{kind}: {reason}'))
    for names in (['wheel_l', 'wheel_r'], ['left_wheel_joint', 'right_wheel_joint'], ['arm']):
        message = JointState(name=names, position=[0.0] * len(names))
        message.header.stamp.sec = 1
        heard['joint_states'](message)
    assert counted == ['joint_states_without_wheels: left_wheel_joint is not among '
                       'wheel_l, wheel_r']


def test_faults_are_counted_and_each_kind_is_said_rarely() -> None:
    log, clock = Log(), [0.0]
    count = Faults(log, lambda: clock[0])
    for _ in range(3):
        count('bad_map', 'because')
    count('bad_scan')
    assert count.counts() == {'bad_map': 3, 'bad_scan': 1}
    assert len(log.lines) == 2
    assert 'because' in log.lines[0]
    clock[0] = 61.0
    count('bad_map', 'again')
    assert 'again (4 so far' in log.lines[2]


def test_a_fault_of_the_start_is_said_only_where_it_lasts() -> None:
    log, clock = Log(), [0.0]
    count = Faults(log, lambda: clock[0])
    for clock[0] in (0.0, 1.9):
        count('no_mount', 'because', patience=2.0)
    assert not log.lines
    clock[0] = 2.1
    count('no_mount', 'because', patience=2.0)
    assert len(log.lines) == 1


@pytest.mark.parametrize(('words', 'level', 'message'), [
    ({}, DiagnosticStatus.OK, 'ok'), ({'warning': 'slow'}, DiagnosticStatus.WARN, 'slow'),
    ({'warning': 'slow', 'error': 'dead'}, DiagnosticStatus.ERROR, 'dead')])
def test_a_status_has_the_level_of_its_worst_word(words: dict[str, str], level: bytes,
                                                  message: str) -> None:
    made = status('node', 'robot1', {'n': 3, 'x': 0.123456}, **words)
    assert (made.level, made.message) == (level, message)
    assert [(v.key, v.value) for v in made.values] == [('n', '3'), ('x', '0.1235')]


def test_numbers_are_written_for_readers() -> None:
    assert [text(v) for v in (float('inf'), 1e-9, True, 'word')] == ['inf', '1e-09', 'True',
                                                                     'word']


def test_clusters_and_markers_show_what_was_learned() -> None:
    learned = learn(fake_grid(fake_room()), FusionConfig())
    rows = cluster_rows(learned.clusters)
    assert rows.shape == (len(learned.clusters), 7)
    assert len(rows) > 20
    array = team_markers(learned, 'map', Time())
    again = deserialize_message(serialize_message(array), type(array))
    by_name = {m.ns: m for m in again.markers}
    assert set(by_name) == {'segments', 'surfaces', 'normals', 'matches'}
    assert len(by_name['segments'].points) == len(by_name['segments'].colors)
    assert len(by_name['normals'].points) == 2 * len(rows)


def session(said: list[str]) -> FusionSession:
    """Make the work of robot1's fusion node."""
    return FusionSession('robot1', TeamConfig(), FusionConfig(), said.append)


def test_nobody_is_connected_before_a_verdict() -> None:
    work = session([])
    assert work.attempt(0.0) is None
    work.take_map('robot1', SharedMap(fake_grid(fake_room())))
    assert work.attempt(0.0) is None
    work.refresh()
    assert work.draw() is not None   # its own map, so that it can navigate and explore
    assert work.snapshot.world('robot1') == {'robot1': Pose()}
    assert work.snapshot.connected('robot1') == []


def test_two_views_of_a_room_are_joined_and_drawn_once() -> None:
    said: list[str] = []
    work, walls = session(said), fake_room(14.0, 11.0)
    work.take_map('robot1', SharedMap(fake_grid(walls)))
    work.take_map('robot2', SharedMap(fake_grid(walls, T_map_walls=Pose(2.0, -1.0, 0.7))))
    assert work.attempt(0.0) == 'robot2'
    assert work.attempt(0.5) is None   # not before its time
    assert work.attempt(10.0) is None   # nor without a change
    snapshot = work.refresh()
    assert set(snapshot.world('robot1')) == {'robot1', 'robot2'}
    assert 'accepted' in said[-1]
    assert work.draw() is not None
    assert work.draw() is None
    heard = {name: Heard(0.0, 0.0, 1) for name in ('robot1', 'robot2')}
    own, peer = fusion_statuses('node', 'robot1', snapshot, heard, {'fault': 2}, 1.0, 30.0)
    assert own.level == peer.level == DiagnosticStatus.OK
    values = {v.key: v.value for v in peer.values}
    assert values['verdict'] == 'accepted'
    assert float(values['V']) > 80.0
    assert {'overlap', 'J', 'runner_up', 'reason', 'ms_per_attempt', 'map_age_s',
            'bytes_received', 'bytes_of_views', 'view_age_s'} <= values.keys()
    lies = replace(snapshot, suspected={'robot2': 'robot2 says what cannot be'})
    peer = fusion_statuses('node', 'robot1', lies, heard, {}, 1.0, 30.0)[1]
    assert (peer.level, peer.message) == (DiagnosticStatus.WARN, 'robot2 says what cannot be')
    work.reset()
    assert work.snapshot.world('robot1') == {'robot1': Pose()}
    assert work.draw() is not None   # the old global map does not stay


class Told:
    """Stands for a node: what is told on each topic, by the publishers that are there."""

    def __init__(self) -> None:
        self.topics: dict[str, list[Any]] = {}
        self.ended: list[str] = []

    def create_publisher(self, kind: type, topic: str, profile: object) -> Any:
        """Begin to tell on a topic; a late joiner hears what is told from now on."""
        said = self.topics[topic] = []
        return SimpleNamespace(publish=said.append, topic=topic, get_subscription_count=lambda: 0)

    def destroy_publisher(self, publisher: Any) -> None:
        """End a publisher."""
        self.ended.append(publisher.topic)

    def get_clock(self) -> Any:
        """Tell the time."""
        return Clock()


def test_body_pose_and_transform_of_a_peer_vanish_when_the_peer_or_its_match_does() -> None:
    work, walls, node = session([]), fake_room(14.0, 11.0), Told()
    publisher = FusionPublisher(node, Frames('robot1', 'map', 'world'), '', 'global_map')
    work.take_map('robot1', SharedMap(fake_grid(walls)))
    work.take_map('robot2', SharedMap(fake_grid(walls, T_map_walls=Pose(2.0, -1.0, 0.7))))
    heard = {robot: Heard() for robot in ('robot1', 'robot2')}
    for robot in heard:
        heard[robot].add_pose(TimedPose(1.0, Pose(1.0, 1.0, 0.0), 0.01 * np.eye(3)))

    def last(topic: str) -> int:
        return len(node.topics[topic][-1].poses)
    assert work.attempt(0.0) == 'robot2'
    publisher.team(work.refresh({'robot2'}), heard, {'robot2'})
    assert (last('peer_bodies'), last('peer_poses')) == (1, 2)
    assert len(node.topics['relative_transforms']) == 1
    publisher.team(work.refresh(set()), heard, set())          # it is gone
    assert (last('peer_bodies'), last('peer_poses')) == (0, 1)
    publisher.team(work.refresh({'robot2'}), heard, {'robot2'})
    assert (last('peer_bodies'), last('peer_poses')) == (1, 2)
    work.reset()
    publisher.team(work.snapshot, heard, {'robot2'})
    assert (last('peer_bodies'), last('peer_poses')) == (0, 1)
    assert node.ended == ['relative_transforms']
    assert node.topics['relative_transforms'] == []            # for who comes late


def test_the_body_of_a_robot_that_only_others_accepted_is_none() -> None:
    """A liar could else have scans cut, and walls erased, where it says that somebody stands."""
    work, walls, node = session([]), fake_room(14.0, 11.0), Told()
    publisher = FusionPublisher(node, Frames('robot1', 'map', 'world'), '', 'global_map')
    for robot, place in (('robot1', Pose()), ('robot2', Pose(2.0, -1.0, 0.7))):
        work.take_map(robot, SharedMap(fake_grid(walls, T_map_walls=place)))
    work.begin('robot3', Epoch('3d'), 0.0)
    work.take_state('robot2', TeamState('s', (MapConstraint(
        'robot2', 'robot3', Pose(), 0.01 * np.eye(3), epochs=(Epoch(), Epoch('3d'))),)))
    heard = {f'robot{k}': Heard() for k in (1, 2, 3)}
    for one in heard.values():
        one.add_pose(TimedPose(1.0, Pose(1.0, 1.0, 0.0), 0.01 * np.eye(3)))
    assert work.attempt(0.0) == 'robot2'
    publisher.team(work.refresh({'robot2', 'robot3'}), heard, {'robot2', 'robot3'})
    assert len(node.topics['peer_poses'][-1].poses) == 3
    assert len(node.topics['peer_bodies'][-1].poses) == 1


@pytest.mark.parametrize(('heard', 'words'), [
    (Heard(99.0), 'has not sent a map'), (Heard(), 'nothing was heard of robot2 yet'),
    (Heard(0.0, 0.0, 1), 'silent for 100 s'),
    (Heard(99.0, 99.0, 1), 'not matched yet')])
def test_a_silent_peer_is_named(heard: Heard, words: str) -> None:
    own = Heard(99.0, 99.0, 1)
    peer = fusion_statuses('node', 'robot1', session([]).snapshot,
                           {'robot1': own, 'robot2': heard}, {}, 100.0, 30.0)[1]
    assert peer.level == DiagnosticStatus.WARN
    assert words in peer.message


def test_a_map_server_that_is_there_is_not_silent() -> None:
    """It tells its map once."""
    own, told = Heard(99.0, 99.0, 1), Heard(0.0, 0.0, 1)
    for present, words in (({'robot2'}, 'not matched yet'), (set(), 'silent for 100 s')):
        peer = fusion_statuses('node', 'robot1', session([]).snapshot,
                               {'robot1': own, 'robot2': told}, {}, 100.0, 30.0,
                               present=present)[1]
        assert words in peer.message
    told.begin('session', 0.0)   # of a fusion node, which says something all the time
    assert 'silent' in fusion_statuses('node', 'robot1', session([]).snapshot,
                                       {'robot1': own, 'robot2': told}, {}, 100.0, 30.0,
                                       present={'robot2'})[1].message


def test_the_player_hands_on_the_bytes_of_a_bag() -> None:
    folder = need_data('logs', 'mines_exp1')
    records = [r for r in Recording(folder).records() if r.msgtype == 'sensor_msgs/msg/LaserScan']
    assert len(records) == 756
    assert [r.time for r in records] == sorted(r.time for r in records)
    scan = deserialize_message(records[0].data, LaserScan)
    assert scan.header.frame_id == 'laser'


def test_the_player_plays_clouds_where_there_are_no_scans_and_refuses_a_bag_of_neither(
        tmp_path: Path) -> None:
    for name, stamps in (('clouds', (100.0, 100.1)), ('none', ())):
        with ResultBag(tmp_path / name) as bag:
            bag.odometry(100.0, (0.0, 0.0, 0.0))
            for stamp in stamps:
                bag.clusters('/points', stamp, 'laser', np.ones((3, 7), np.float32))
    recording = Recording(tmp_path / 'clouds')
    recording.shift = 10 ** 9
    clouds = [deserialize_message(r.data, PointCloud2) for r in recording.records()
              if r.msgtype == recording.scans]
    assert [(c.header.stamp.sec, c.width) for c in clouds] == [(101, 3), (101, 3)]
    recording.close()
    with pytest.raises(ValueError, match='no laser scans to play'):
        Recording(tmp_path / 'none')


def test_the_player_plays_what_can_be_read_of_a_bag_that_is_spoilt(tmp_path: Path) -> None:
    write_fake_bag(tmp_path / 'good', every=4)
    whole = list(Recording(tmp_path / 'good').records())
    for name in ('metadata', 'cut'):
        shutil.copytree(tmp_path / 'good', tmp_path / name)
    (tmp_path / 'metadata' / 'metadata.yaml').write_text('storage_identifier:')
    file = next((tmp_path / 'cut').glob('*.mcap'))
    file.write_bytes(file.read_bytes()[:-file.stat().st_size // 2])
    (tmp_path / 'cut' / 'metadata.yaml').unlink()
    recording, cut = Recording(tmp_path / 'metadata'), Recording(tmp_path / 'cut')
    assert list(recording.records()) == whole
    assert 'metadata.yaml cannot be used' in recording.notes[0]
    played = list(cut.records())
    assert played == whole[:len(played)]
    assert 10 < len(played) < len(whole)
    assert 'cut off' in cut.notes[0]


def test_the_player_stamps_what_has_no_stamp_with_its_time_of_recording(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(3):
            bag.recorded = 50.0 + 0.1 * number
            bag.odometry(0.0, (0.0, 0.0, 0.0))
            bag.scan(fake_scan(fake_room(), Pose(), 0.0))
    recording = Recording(tmp_path / 'bag')
    recording.shift = 10 ** 9
    stamps = [deserialize_message(r.data, LaserScan).header.stamp for r in recording.records()
              if r.msgtype == recording.scans]
    assert [(s.sec, s.nanosec) for s in stamps] == [(51, 0), (51, 10 ** 8), (51, 2 * 10 ** 8)]
    assert sum('messages_without_stamp' in note for note in recording.notes) == 1


@pytest.mark.skipif(TFMessage is None, reason='tf2_msgs is not here')
def test_the_player_plays_the_odometry_that_is_in_tf_alone(tmp_path: Path) -> None:
    """And of /tf nothing else: map -> odom is slam_node's own."""
    for name, parents in (('tf', ('map', 'odom')), ('none', ('map',))):
        with BagWriter(tmp_path / name) as bag:
            for number in range(3):
                stamp = 1.0 + 0.1 * number
                for parent in parents:
                    bag.transform('/tf', stamp, parent, 'odom' if parent == 'map' else 'base_link',
                                  (0.1 * number, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
                bag.scan(fake_scan(fake_room(), (2.0, 2.0, 0.0), stamp))
    recording = Recording(tmp_path / 'tf')
    recording.shift = 5 * 10 ** 9
    played = [deserialize_message(record.data, TFMessage) for record in recording.records()
              if record.msgtype == ODOMETRY_IN_TF]
    assert [(item.child_frame_id, item.header.stamp.sec, round(item.transform.translation.x, 3))
            for message in played for item in message.transforms] == [
        ('base_link', 6, 0.0), ('base_link', 6, 0.1), ('base_link', 6, 0.2)]
    assert not recording.notes
    assert 'no odometry to play' in Recording(tmp_path / 'none').notes[0]


def test_the_player_plays_the_scans_and_the_odometry_that_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'two') as bag:
        for number in range(2):
            bag.odometry(1.0 + number, (0.0, 0.0, 0.0))
            for topic in ('/front', '/back'):
                scan = fake_scan(fake_room(), (2.0, 2.0, 0.0), 1.0 + number)
                bag.scan(replace(scan, range_max=5.0) if topic == '/back' else scan, topic=topic)
    with pytest.raises(ValueError, match='which of /back, /front is .*Name it by --scan-topic'):
        Recording(tmp_path / 'two')
    with pytest.raises(ValueError, match=r'no laser scans on topic left \(found: /back, /front'):
        Recording(tmp_path / 'two', 'left')
    for name in ('back', '/back'):
        recording = Recording(tmp_path / 'two', name, 'odom')
        scans = [deserialize_message(r.data, LaserScan) for r in recording.records()
                 if r.msgtype == recording.scans]
        assert [scan.range_max for scan in scans] == [5.0, 5.0]
        assert 'nav_msgs/msg/Odometry' in recording.msgtypes


@pytest.mark.parametrize(('given', 'topics'), [
    ([], [None, None]), (['--scan-topic', 'front'], ['front', 'front']),
    (['--scan-topic', 'front', 'base'], ['front', 'base'])])
def test_topics_are_named_for_all_bags_or_each(given: list[str], topics: list[str | None]) -> None:
    options = player_options.parse(['a', 'b', *given])
    assert player.each(options.scan_topic, options) == topics
    with pytest.raises(SystemExit):
        player_options.parse(['a', 'b', '--scan-topic', 'x', 'y', 'z'])


def test_the_core_logs_nothing_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    logging.getLogger('somfusion_ros').warning('unheard')
    assert 'unheard' not in capsys.readouterr().err


@pytest.mark.parametrize(('robots', 'told'), [
    (['a', 'a'], 'robots a, a: each needs a name of its own'), (['a'], '1 robots for 2 bags'),
    (['a', 'b-c'], 'Invalid topic name')])
def test_robots_that_cannot_be_are_refused_by_the_player_in_a_line(
        robots: list[str], told: str, tmp_path: Path, ros_domain: int,
        capfd: pytest.CaptureFixture[str]) -> None:
    bags = [str(tmp_path / name) for name in ('one', 'two')]
    for bag in bags:
        write_fake_bag(Path(bag), every=20)
    assert player.main([*bags, '--wait', '0', '--robots', *robots]) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert told in line


def test_a_bag_that_is_none_is_said_by_the_player(tmp_path: Path) -> None:
    with pytest.raises(Exception, match='nothing: no such file or folder'):
        Recording(tmp_path / 'nothing')


class TopicsOnly:
    """A node that only notes who publishes and listens where, by the topic's whole name."""

    def __init__(self, **remapped: str) -> None:
        self.heard: dict[str, Any] = {}
        self.told: dict[str, list[Any]] = {}
        self._remapped = remapped

    def create_subscription(self, _: type, topic: str, callback: Any, qos: Any) -> Any:
        """Listen to a topic."""
        name = self._remapped.get(topic, topic if topic.startswith('/') else f'/{topic}')
        self.heard[name] = callback
        return SimpleNamespace(topic_name=name)

    def create_publisher(self, _: type, topic: str, qos: Any) -> Any:
        """Publish on a topic."""
        told = self.told.setdefault(topic if topic.startswith('/') else f'/{topic}', [])
        return SimpleNamespace(publish=told.append, get_subscription_count=lambda: 1)

    def get_clock(self) -> Any:
        """Return a clock that stands still."""
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))


@pytest.mark.parametrize(('prefix', 'remapped', 'retold'), [
    ('/robot1/', {}, True), ('/robot1/', {'views': '/robot1/views'}, False), ('', {}, False)])
def test_views_of_a_robot_in_the_root_namespace_are_told_below_its_name(
        prefix: str, remapped: dict[str, str], retold: bool) -> None:
    node, kept = TopicsOnly(**remapped), []
    inbox = SimpleNamespace(keep_batch=lambda robot, data: kept.append((robot, data)))
    session = FusionSession('robot1', TeamConfig(), FusionConfig(), lambda line: None)
    ViewLink(node, prefix, 'robot1', session, inbox, lambda kind, reason: None, 'start')
    message = UInt8MultiArray(data=b'some views')
    node.heard[remapped.get('views', '/views')](message)
    assert kept == [('robot1', b'some views')]
    assert node.told.get('/robot1/views', []) == ([message] if retold else [])


def test_where_the_team_has_the_own_views_is_told_and_heard() -> None:
    """What fusion_node tells on joint_path is what slam_node with use_peers takes."""
    shown = np.array([(1.0, 2.0, 0.3), (1.5, 2.1, 0.4)])
    session = FusionSession('robot1', TeamConfig(), FusionConfig(), lambda line: None)
    session.elastic.own_path = lambda: (np.array([100.25, 101.5]), shown)  # type: ignore
    node, taken = TopicsOnly(), []
    link = ViewLink(node, '', 'robot1', session, SimpleNamespace(), lambda kind, reason: None,
                    'start')
    JointPath(node, lambda *path: taken.append(path), lambda kind, reason: None)
    for _ in range(2):
        link.say_joint('world')
    message, = node.told['/joint_path']      # once
    node.heard['/joint_path'](message)
    (stamps, poses), = taken
    assert stamps == pytest.approx([100.25, 101.5], abs=1e-6)
    assert poses == pytest.approx(shown, abs=1e-9)
    message.poses[0].pose.position.x = float('nan')
    node.heard['/joint_path'](message)
    assert len(taken) == 1


def test_the_mount_of_a_second_laser_that_comes_later_on_tf_is_heard() -> None:
    """A robot without tf_static repeats the mounts of both on /tf, one after the other."""
    heard: dict[str, Any] = {}
    node = SimpleNamespace(
        get_logger=Log, get_namespace=lambda: '/robot1',
        create_subscription=lambda kind, topic, take, *_: heard.update({topic: take}) or topic,
        destroy_subscription=heard.pop)
    mounts = Mounts(node, None, lambda kind, reason='': None)

    def repeat(laser: str) -> None:
        if '/tf' in heard:
            heard['/tf'](SimpleNamespace(transforms=[transform_message(
                Pose(0.2, 0.0, 0.0), 'base_link', laser, Time())]))
    repeat('front')
    assert mounts.find('base_link', 'front') is not None
    assert '/tf' not in heard, 'it is busy, and all is known'
    assert mounts.find('base_link', 'back') is None
    repeat('back')
    assert mounts.find('base_link', 'back') is not None
    assert '/tf' not in heard


def test_a_map_that_is_drawn_while_a_reset_comes_is_not_published() -> None:
    """It would be of the old epoch, told after that of the new one."""
    said: list[Any] = []
    publisher = SimpleNamespace(epoch=said.append, grid=lambda *_: said.append('map'),
                                map_message=lambda *_: OccupancyGrid())
    pipeline = Pipeline(lambda beginning: Session(SlamConfig(), 0.5, lambda *_: None), Beginning(),
                        SimpleNamespace(), publisher, Last(), lambda *_: None, print)
    pipeline._mapper = SimpleNamespace(stopping=False)
    old, grid = pipeline.session.slam, fake_grid(fake_room())
    pipeline._publish_map(old, grid, None)
    assert (said[1:], pipeline.map) == (['map'], OccupancyGrid())
    pipeline._begin(Beginning())
    pipeline._publish_map(old, grid, None)
    assert said.count('map') == 1
    assert pipeline.map is None, 'dynamic_map would answer with it'


@pytest.mark.parametrize(('odom', 'base', 'chosen'), [
    ('robot1/odom', 'base_link', 'robot1/odom'), ('robot2/odom', 'base_link', 'robot2/odom'),
    ('drifting', 'body', 'drifting'), ('no_such', 'base_link', 'robot2/odom')])
def test_the_odometry_in_tf_is_that_of_odom_frame(odom: str, base: str, chosen: str) -> None:
    """Several robots share one /tf, and this one has no namespace that would tell which it is."""
    heard, poses, counted = {}, [], []
    node = SimpleNamespace(
        get_clock=Clock, get_logger=Log, get_namespace=lambda: '/',
        create_subscription=lambda kind, topic, take, *_, **__: (
            heard.update({topic: take}) or SimpleNamespace(topic_name=topic)))
    config = SlamNodeConfig(odometry_source='tf', odom_frame=odom, base_frame=base)
    OdometryInput(node, config, lambda stamp, pose, slip: poses.append(pose[0]), print,
                  lambda kind, reason: counted.append(kind))
    places = {'robot1/odom': 1.0, 'robot2/odom': 2.0, 'drifting': 3.0}
    for x in (0.0, float('nan')):
        heard['/tf'](SimpleNamespace(transforms=[transform_message(
            Pose(place + x, 0.0, 0.0), parent,
            'body' if parent == 'drifting' else parent.replace('odom', 'base_link'), Time(sec=1))
            for parent, place in places.items()]))
    assert poses == [places[chosen]]
    assert counted == [*['odom_frame_differs'] * (chosen != odom), 'odometry_not_finite']


def test_watch_shows_what_the_teams_nodes_say_and_no_driver() -> None:
    watch, message = SimpleNamespace(_team=HeardTeam()), DiagnosticArray()
    message.status = [status(name, '', {}) for name in (
        'robot1/slam_node', 'robot1/fusion_node: robot2', 'hokuyo: connection', 'Nav2 Health')]
    WatchNode._on_diagnostics(watch, message)
    assert list(watch._team.health) == ['robot1/slam_node', 'robot1/fusion_node: robot2']


@pytest.mark.parametrize(('robot', 'below', 'shown'), [
    ('robot1', '/robot1', 'robot1'), ('', '', '/')])
def test_watch_listens_to_a_robot_in_the_root_namespace_too(robot: str, below: str, shown: str
                                                            ) -> None:
    topics = [(f'{below}/map', ['nav_msgs/msg/OccupancyGrid']), ('/scan', ['x']),
              ('/robot1/global_map', ['nav_msgs/msg/OccupancyGrid']), ('/map', ['x'])]
    assert find_robots(topics, 'map', 'nav_msgs/msg/OccupancyGrid') == [robot]
    heard: dict[str, Any] = {}
    watch = SimpleNamespace(
        _options=SimpleNamespace(map_topic='map'), _team=HeardTeam(),
        create_subscription=lambda kind, topic, take, profile: heard.update({topic: take}))
    watch._on_map = watch._on_transform = print
    watch._on_pose = partial(WatchNode._on_pose, watch)
    WatchNode._listen(watch, robot)
    assert set(heard) == {f'{below}/{name}' for name in ('map', 'relative_transforms', 'pose')}
    heard[f'{below}/pose'](PoseWithCovarianceStamped())
    assert watch._team.poses == {shown: Pose()}


def test_watch_passes_over_places_that_are_none() -> None:
    watch, pose = SimpleNamespace(_team=HeardTeam()), PoseWithCovarianceStamped()
    pose.pose.pose.position.x = float('nan')
    WatchNode._on_pose(watch, 'robot1', pose)
    WatchNode._on_transform(watch, 'robot1', transform_message(
        Pose(float('nan'), 0.0, 0.0), 'map', 'robot2/map', Time()))
    assert watch._team.poses == {}
    assert not watch._team.transforms.get('robot1')


@pytest.mark.parametrize(('frame', 'told'), [
    ('', 'the scans have no frame_id'),
    ('laser', 'no transform base_link -> laser on /tf_static')])
def test_what_a_scan_without_a_mount_lacks_is_told(frame: str, told: str) -> None:
    mounts = SimpleNamespace(find=lambda base, laser: None, hint=lambda base, laser: '')
    node = SimpleNamespace(_config=SlamNodeConfig(), _last=Last(), _mounts=mounts)
    assert SlamNode._mount_of(node, frame) is None
    assert node._last.lacking.startswith(told)
    assert 'set laser_pose' in node._last.lacking
