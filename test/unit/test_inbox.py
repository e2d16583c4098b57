# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of a robot that was gone for a while, told by itself and by others, in any order."""

from collections import Counter
from itertools import permutations
from types import SimpleNamespace

from helpers import fake_grid, furnished_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, CLUSTERS, MAP, PLAIN_MAP, STATE
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.inbox import Inbox, MOST_TRANSFORMS, TimedClusters
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.lent_map import lent_map
from somfusion_ros.team.map_codec import HEADER, Header, key_message, MapEncoder, number_of
from somfusion_ros.team.plain_epochs import PlainMap
from somfusion_ros.team.scouting import Scouting
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells, SharedMap
from somfusion_ros.team.state_codec import decode_state, encode_state, TeamState

ROOM = fake_grid(furnished_room())
CELLS = MapCells(ROOM.to_occupancy(), ROOM.resolution, ROOM.T_frame_grid)
EPOCH = Epoch('2e')


def version(number: int) -> MapCells:
    """Make a map that knows more with every version."""
    values = CELLS.values.copy()
    values[:, 40 + 20 * number:] = -1
    return CELLS._replace(values=values)


def numbered(message: bytes, number: int) -> bytes:
    """Give another number to a message of a map."""
    header = Header(*HEADER.unpack_from(message))._replace(number=number)
    return HEADER.pack(*header) + message[HEADER.size:]


class Listener:
    """Robot a, which hears robot z."""

    def __init__(self) -> None:
        self.session = FusionSession('a', TeamConfig(), FusionConfig(), lambda text: None)
        self.counted: list[str] = []
        self.now = self.stamp = 0.0
        self.inbox = Inbox('a', self.session, 10 ** 6, lambda kind, _: self.counted.append(kind),
                           lambda: self.now, lambda: self.stamp)
        self.inbox.heard = {'a': Heard(), 'z': Heard()}
        self.session.begin('a', Epoch('1f'), 0.0)
        self.session.take_map('a', SharedMap(ROOM))
        self.hear(STATE, TeamState('ab12', epoch=EPOCH))

    def hear(self, channel: str, message: object) -> None:
        """Take a message at once."""
        rank = number_of(message) if isinstance(message, bytes) else 0
        self.inbox.keep('z', channel, message, 1, lambda content: content, rank)
        self.inbox.drain()

    def look(self, present: bool) -> None:
        """Look whether z is there."""
        self.session.refresh({'z'} if present else set())
        self.inbox.drain()

    def assert_shows(self, cells: MapCells) -> None:
        """Check which map of z is shown."""
        shown = self.session.shown_maps()['z'].grid
        assert np.array_equal(shown.to_occupancy(), cells.values)


@given(st.permutations(['state', 'map', 'late map', 'clusters', 'pose']))
def test_what_is_of_another_map_waits_or_changes_nothing(order: list[str]) -> None:
    """
    Whatever overtakes what on the network, and though late words of the old map come after.

    An old map came late, and the new one, which waited for its word, was lost: so chaos found it.
    """
    listener, new = Listener(), Epoch('3d')
    looked: list[int] = []
    listener.session.scouting.update = lambda robot, clusters: looked.append(clusters)
    listener.hear(MAP, key_message(version(1), EPOCH, 1))
    messages = {'state': (STATE, TeamState('ab12', epoch=new, since=7, number=2)),
                'map': (MAP, key_message(version(2), new, 2)),
                'late map': (MAP, key_message(version(0), EPOCH, 1)),
                'clusters': (CLUSTERS, TimedClusters(8, 8))}

    def poses() -> list[Pose]:
        return [item.pose for item in listener.inbox.heard['z'].poses]

    def tell_pose(x: float, epoch: Epoch) -> None:
        listener.inbox.keep_pose('z', lambda: (TimedPose(1.0, Pose(x), np.eye(3)), epoch))
    tell_pose(1.0, EPOCH)
    for what in order:
        if what == 'pose':
            tell_pose(2.0, new)
        else:
            listener.hear(*messages[what])
    told = order.index('state') < order.index('pose')
    assert poses() == ([Pose(2.0)] if told else [])
    listener.assert_shows(version(2))
    listener.hear(MAP, key_message(version(3), EPOCH, 3))
    listener.hear(CLUSTERS, TimedClusters(6, 6))
    tell_pose(3.0, EPOCH)
    assert poses() == ([Pose(2.0)] if told else [])
    listener.assert_shows(version(2))
    assert looked == [8]


def test_clusters_that_overtook_the_word_on_their_map_are_looked_at() -> None:
    scouting, asked = Scouting(0.1, matchers=SimpleNamespace(screen=lambda own, clusters, *_: (
        asked.append(clusters) or SimpleNamespace(likely=False)))), []
    scouting.update('z', 1)
    assert scouting.look(ROOM, (), FusionConfig(), 0.0) == 'z'
    scouting.update('z', 2)
    scouting.look_again('z')       # its map is another one
    assert scouting.look(ROOM, (), FusionConfig(), 1.0) == 'z'
    assert asked == [1, 2]


def test_changes_go_on_after_others_told_the_map() -> None:
    encoder, listener = MapEncoder(), Listener()
    encoder.encode(version(1), EPOCH)
    listener.hear(MAP, encoder.key)
    listener.look(present=False)
    listener.hear(MAP, key_message(version(2), EPOCH))
    listener.assert_shows(version(2))
    listener.look(present=True)       # it comes again only as what changed: the key is known
    encoder.encode(version(3), EPOCH)
    assert encoder.change is not None
    listener.hear(CHANGES, encoder.change)
    listener.assert_shows(version(3))


def test_what_others_lend_is_never_taken_for_the_own_word_of_a_robot() -> None:
    """With a number it would be shown unexamined, and be newer than all that comes later."""
    encoder, listener = MapEncoder(), Listener()
    encoder.encode(version(1), EPOCH)
    listener.hear(MAP, encoder.key)
    listener.look(present=False)
    encoder.encode(version(0), EPOCH)
    assert encoder.change is not None
    for lie in (key_message(version(0), EPOCH, 1 << 60), numbered(encoder.change, 0)):
        listener.inbox.keep('z', MAP, lie, 1, lent_map)
        listener.inbox.drain()
        listener.assert_shows(version(1))
    assert listener.counted == ['map_of_z_unusable'] * 2
    listener.look(present=True)
    encoder.encode(version(3), EPOCH)
    listener.hear(CHANGES, encoder.change)
    listener.assert_shows(version(3))


def test_a_map_may_become_again_what_it_was() -> None:
    """A new key was like the first one, and the last change of that was put on it."""
    encoder, listener = MapEncoder(), Listener()
    encoder.encode(version(1), EPOCH)
    listener.hear(MAP, encoder.key)
    encoder.encode(version(2), EPOCH)
    assert encoder.change is not None
    listener.hear(CHANGES, encoder.change)
    listener.assert_shows(version(2))
    listener.hear(MAP, key_message(version(1), EPOCH, 3))
    listener.assert_shows(version(1))


@pytest.mark.parametrize('order', [*permutations(range(4))])
def test_the_newest_map_is_shown_in_whatever_order_its_parts_come(order: tuple[int, ...]) -> None:
    """A change waited for its key, and an older one that came late took its place."""
    first, second, listener = MapEncoder(), MapEncoder(), Listener()
    first.encode(version(1), EPOCH)
    first.encode(version(2), EPOCH)
    second.encode(version(3), EPOCH)
    second.encode(version(4), EPOCH)
    parts = [(MAP, first.key), (CHANGES, first.change), (MAP, second.key),
             (CHANGES, second.change)]
    for k in order:
        channel, data = parts[k]
        assert data is not None
        listener.hear(channel, numbered(data, k + 1))
    listener.assert_shows(version(4))
    assert not listener.counted


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from(['own', 'lent', 'gone', 'back']), max_size=12))
def test_who_is_back_is_shown_as_it_told_itself_last(story: list[str]) -> None:
    encoder, listener = MapEncoder(), Listener()
    encoder.encode(version(0), EPOCH)
    listener.hear(MAP, encoder.key)
    for number, event in enumerate(story, start=1):
        if event == 'own':
            encoder.encode(version(number), EPOCH)
            listener.hear(CHANGES if encoder.change else MAP, encoder.change or encoder.key)
        elif event == 'lent':
            listener.hear(MAP, key_message(version(13), EPOCH))
        else:
            listener.look(present=event == 'back')
    listener.look(present=True)
    last = max((k for k, event in enumerate(story, start=1) if event == 'own'), default=0)
    listener.assert_shows(version(last))


def test_a_robot_that_two_liars_took_the_map_of_has_it_again_when_it_is_back() -> None:
    """They said that it had another one, and fell silent; it says nothing new."""
    listener = Listener()
    listener.hear(MAP, key_message(version(3), EPOCH, 1))
    other = DepartedRobot('z', 10 ** 9, (), Epoch('9f'))
    for liar in ('b', 'c'):
        listener.session.take_state(liar, TeamState('11a7', departed=(other,)))
    listener.session.refresh({'b', 'c'})
    assert 'z' not in listener.session._team.maps       # most say so
    listener.session.refresh(set())
    assert listener.session.epoch_of('z') is None
    listener.hear(STATE, TeamState('ab12', epoch=EPOCH, number=2))
    listener.look(True)
    listener.assert_shows(version(3))


@pytest.mark.parametrize(('own_lag', 'ahead', 'said'), [
    (0.1, 0.0, []), (1.6, 0.0, ['pose_of_a_late']), (0.1, 1.6, ['clock_of_z_ahead']),
    (1.6, 1.6, ['clock_of_z_ahead'])])
def test_a_slow_slam_of_its_own_is_no_clock_of_a_peer(own_lag: float, ahead: float,
                                                      said: list[str]) -> None:
    """The peer's poses come at once, by its clock; the own ones late, steadily."""
    listener = Listener()
    listener.hear(STATE, TeamState('ab12', epoch=EPOCH))
    listener.counted.clear()      # the state came twice
    for k in range(9):
        listener.now, listener.stamp = 70.0 + 0.2 * k, 5000.0 + 0.2 * k
        for robot, stamp in (('a', listener.stamp - own_lag), ('z', listener.stamp + ahead)):
            item = TimedPose(stamp, Pose(0.1 * k), np.eye(3))
            listener.inbox.keep_pose(robot, lambda item=item: (item, EPOCH if k < 0 else None))
    assert [*dict.fromkeys(listener.counted)] == said


def test_the_log_names_the_robot_whose_map_shows_too_little() -> None:
    """Of a pair, the first name is the target, whoever matches it."""
    said: list[str] = []
    session = FusionSession('b', TeamConfig(), FusionConfig(), said.append)
    empty = fake_grid(np.array([[0.0, 0.0, 1.0, 0.0]]))
    for robot, grid in (('a', empty), ('b', ROOM)):
        session.begin(robot, Epoch('1f'), 0.0)
        session.take_map(robot, SharedMap(grid))
    assert session.attempt(0.0) == 'a'
    assert "a's map shows too little" in said[-1]


def test_a_robot_that_is_heard_no_more_leaves_nothing_behind() -> None:
    """However many names come and go, with clusters that wait to be looked at."""
    listener = Listener()
    for k in range(9):
        listener.inbox.heard[f'g{k}'] = Heard()
        listener.session.scouting.update(f'g{k}', SimpleNamespace())
        listener.inbox.forget(f'g{k}')
    listener.look(True)
    assert listener.session.scouting.unlikely == set()
    assert len(listener.session.scouting._peers) == 0


@pytest.mark.parametrize('late', [1.0, 30.0])
def test_the_own_map_is_told_again_where_its_publisher_is_noticed_late(late: float) -> None:
    """On a busy computer: it was told in an epoch that no state named, and peers waited for it."""
    listener = Listener()
    inbox = listener.inbox
    inbox.keep('a', PLAIN_MAP, PlainMap(CELLS), 1, lambda content: content)
    assert inbox.drain() is None                # it waits for a word on what it is,
    listener.now = 3.0
    assert inbox.drain() is not None            # and is told without
    first = listener.session.epoch_of('a')
    listener.now += late
    inbox.plain.publisher('a', '5d')
    assert np.array_equal(inbox.drain().values, CELLS.values)
    assert listener.session.epoch_of('a') == Epoch('5d') != first
    assert inbox.drain() is None


@pytest.mark.parametrize('first, joined', [(None, True), (EPOCH, True), (Epoch('1d'), False)])
def test_a_late_listener_hears_for_which_map_the_user_gave_a_pose(
        first: Epoch | None, joined: bool) -> None:
    """A robot that was cut off when z began its second map gave it the pose of the first."""
    listener, said = Listener(), list[str]()
    listener.session = listener.inbox._session = FusionSession(
        'a', TeamConfig(known_init_poses=True, initial_poses=('a 0 0 0', 'z 3 0 0')),
        FusionConfig(), lambda text: None, count=lambda kind, reason: said.append(kind))
    listener.session.begin('a', Epoch('1f'), 0.0)
    listener.session.take_map('a', SharedMap(ROOM))
    listener.hear(STATE, TeamState('ab12', epoch=EPOCH, given=first, number=1))
    listener.hear(MAP, key_message(version(1), EPOCH, 1))
    listener.look(True)
    assert ('z' in listener.session.snapshot.world('a')) == joined
    assert ('initial_pose_of_z_lapsed' in said) != joined
    assert {*listener.session.snapshot.denied} == (set() if joined else {'z'})


def test_a_listener_hears_that_a_pose_is_not_of_the_map_of_now() -> None:
    """A robot was started anew and tells that its pose is of its new map; b knew the old one."""
    listener = Listener()
    listener.session = listener.inbox._session = FusionSession(
        'a', TeamConfig(known_init_poses=True, initial_poses=('a 0 0 0', 'b 1 0 0', 'z 3 0 0')),
        FusionConfig(), lambda text: None)
    listener.session.begin('a', Epoch('1f'), 0.0)
    listener.session.take_map('a', SharedMap(ROOM))
    listener.hear(STATE, TeamState('ab12', epoch=EPOCH, given=EPOCH, number=1))
    listener.hear(MAP, key_message(version(1), EPOCH, 1))
    listener.look(True)
    assert 'z' in listener.session.snapshot.world('a')
    listener.session.take_state('b', decode_state(encode_state(TeamState(
        'cd34', denied={'z': EPOCH}))))
    listener.look(True)
    assert 'z' not in listener.session.snapshot.world('a')
    assert listener.session.snapshot.denied == {'z': EPOCH}


@pytest.mark.parametrize('what', ['state', 'plain map', 'map', 'early'])
def test_a_robot_that_is_forgotten_while_it_is_read_costs_nobody_anything(what: str) -> None:
    """Another thread forgets it; what came of the own map in the same pass is told at once."""
    listener = Listener()
    inbox, now = listener.inbox, PlainMap(CELLS, (0, 0))
    listener.now = 10.0
    inbox.plain.tell('a', Epoch('4e'), (0, 0))
    inbox.plain.tell('z', Epoch('5e'), (9 if what == 'early' else 0, 0))
    channel, content = {
        'state': (STATE, TeamState('cd34', epoch=Epoch('3d'))), 'plain map': (PLAIN_MAP, now),
        'early': (PLAIN_MAP, now), 'map': (MAP, key_message(version(1), EPOCH, 1))}[what]

    def read(content: object) -> object:
        inbox.forget('z')
        return content
    inbox.keep('a', PLAIN_MAP, now, 1, lambda content: content)
    inbox.keep('z', channel, content, 1, read)
    assert inbox.drain() is not None
    inbox.keep('z', STATE, TeamState('cd34', number=9), 1, read)     # on its way meanwhile
    assert inbox.drain() is None and not listener.counted
    assert 'z' not in listener.session.refresh().world('a')
    assert not inbox._unread.addresses()     # nothing waits for it


def test_a_pass_that_fails_tells_the_own_map_with_the_next() -> None:
    listener = Listener()
    inbox = listener.inbox
    inbox.plain.tell('a', Epoch('4e'), (0, 0))
    inbox.keep('a', PLAIN_MAP, PlainMap(CELLS, (0, 0)), 1, lambda content: content)
    inbox.keep('z', MAP, b'', 1, lambda content: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        inbox.drain()
    assert inbox.drain() is not None and inbox.drain() is None


def test_a_robot_that_floods_takes_nobody_elses_place() -> None:
    listener = Listener()
    inbox = listener.inbox
    inbox.heard['b'] = Heard()
    for k in range(3 * MOST_TRANSFORMS):
        inbox.keep_transform('z', f'robot{k}', k, lambda content: content)
    inbox.keep_transform('b', 'a', 0, lambda content: content)
    waiting = Counter(robot for robot, _ in inbox._unread.addresses())
    assert waiting == {'z': MOST_TRANSFORMS, 'b': 1}


def test_where_the_map_of_a_robot_lay_is_forgotten_with_it() -> None:
    """Else a name that came back years later would have jumped; and names come and go."""
    session = Listener().session
    for peer in ('z', 'ghost'):
        session._jumps.look(peer, Pose())
    session.refresh({'z'})
    assert session._jumps.peers() == ['z']
