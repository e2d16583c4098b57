# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where robots were, and what they saw, against what look-alike maps say."""

from dataclasses import replace

from helpers import cut_grid, fake_grid, furnished_room
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.simulation.chaos.tapes import LASER
from somfusion_ros.simulation.drive import at, follow
from somfusion_ros.simulation.floor_plan import box, corridor
from somfusion_ros.simulation.laser import Scene
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.scan import cloud
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.inbox import Inbox
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.outbox import Outbox
from somfusion_ros.team.presence import Meeting, Presence, TUNING
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.state_codec import decode_state, TeamState
from test_elastic import bent_team
from test_elastic_session import batches, EPOCHS

P = np.diag([1e-4, 1e-4, 1e-6])
T_OWN_PEER = Pose(3.0, -1.0, 0.7)
WAY = [Pose(0.5 * k, 0.3 * np.sin(k), 0.1 * k) for k in range(20)]     # of a robot, in a map


def driven(way: list[Pose], beside: list[Pose]) -> Presence:
    """Let two robots drive: where the own one was, and where the peer was beside it."""
    presence = Presence()
    for own, T_own_there in zip(way, beside, strict=True):
        there = compose(own, T_own_there)
        presence.meet('b', Meeting(own, Pose.from_array(between(T_OWN_PEER, there))))
    return presence


def test_two_robots_that_would_move_as_one_are_not_where_the_maps_say() -> None:
    at_one = driven(WAY, [Pose(0.05, 0.1, 3.0)] * 20)
    assert at_one.contradicted('b', T_OWN_PEER) >= TUNING.proof
    assert not at_one.contradicted('b', Pose(8.0, 0.0, 0.7))
    assert not at_one.contradicted('c', T_OWN_PEER)
    at_one.forget('b')
    assert not at_one.contradicted('b', T_OWN_PEER)


@given(st.floats(0.3, 5.0), st.floats(-3.0, 3.0))
def test_robots_that_follow_one_another_however_closely_are_believed(gap: float, side: float
                                                                     ) -> None:
    beside = Pose(gap * np.cos(side), gap * np.sin(side), 0.0)
    assert not driven(WAY, [beside] * 20).contradicted('b', T_OWN_PEER)


def test_robots_that_met_now_and_then_in_logs_of_different_days_are_believed() -> None:
    """Up to three places of many; at four there is something wrong."""
    apart = Pose(2.0, 0.0, 0.0)
    for many in range(6):
        beside = [Pose() if k < 3 * many and k % 3 == 0 else apart for k in range(20)]
        assert bool(driven(WAY, beside).contradicted('b', T_OWN_PEER)) == (many >= TUNING.proof)


def test_of_few_meetings_most_are_enough() -> None:
    assert driven(WAY[:2], [Pose()] * 2).contradicted('b', T_OWN_PEER) == 1
    assert not driven(WAY[:1], [Pose()]).contradicted('b', T_OWN_PEER)


def scan(walls: float, body: float | None = None, hidden: bool = False) -> Outline:
    """See walls all around at a distance, and a body of 0.3 m ahead; or what was left out."""
    angle = np.radians(np.arange(-90.0, 90.5, 0.5))
    reach = np.full(len(angle), walls)
    if body is not None:
        on_it = np.abs(np.tan(angle) * body) < 0.15
        reach[on_it & (np.abs(angle) < 1.0)] = 0.0 if hidden else body - 0.15
    reach[::17] = 0.0       # beams that tell nothing
    ends = reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + LASER.mount[:2]
    return Outline(ends.astype(np.float32), reach.astype(np.float32), reach > 0.0,
                   np.array(LASER.mount[:2]))


@pytest.mark.parametrize(('seen', 'wrong'), [
    (scan(9.0), True),                      # the laser looks through where the peer should stand
    (scan(9.0, 3.0), False),                # there it stands
    (scan(9.0, 2.8), False),                # or a little nearer
    (scan(9.0, 3.0, hidden=True), False),   # it was left out of the scan
    (scan(2.0), False)])                    # a wall hides it
def test_a_laser_that_looks_through_a_body_says_that_nobody_is_there(seen: Outline, wrong: bool
                                                                     ) -> None:
    presence = Presence()
    for own in WAY:
        there = compose(own, Pose(3.0, 0.1, 1.0))
        presence.meet('b', Meeting(own, Pose.from_array(between(T_OWN_PEER, there)), seen))
    assert bool(presence.contradicted('b', T_OWN_PEER)) == wrong


@pytest.mark.slow
def test_lasers_that_see_robots_tell_ends_of_a_corridor_apart_that_maps_do_not(
        rng: np.random.Generator) -> None:
    """The second robot drives 15 s later; at the true transform the laser contradicts nothing."""
    plan, late, ways = corridor(), 15.0, []
    for robot, wait in ((0, 0.0), (1, late)):
        route = plan.route(robot)
        stamps, poses = follow(route, float(np.arctan2(*(route[1] - route[0])[::-1])), 0.7, 45.0)
        ways.append((np.r_[0.0, stamps + wait], np.concatenate([poses[:1], poses])))
    starts = [Pose.from_array(poses[0]) for _, poses in ways]
    one, two = Presence(), Presence()
    for t in np.arange(late, 45.0, 1.0):
        first, second = (at(*way, np.array([t]))[0] for way in ways)
        scene = Scene(np.concatenate([plan.segments, box(*first[:2], 0.4, 0.4)]))
        seen = cloud(LASER.scan(t, scene, np.tile(second, (LASER.beams, 1)), rng), 12.0).outline
        pair = [Pose.from_array(between(start, pose))
                for start, pose in zip(starts, (first, second), strict=True)]
        one.meet('b', Meeting(*pair, by_peer=seen))       # both know what the second one saw
        two.meet('a', Meeting(*pair[::-1], seen))
    for presence, peer, truth in ((one, 'b', between(*starts)),
                                  (two, 'a', between(*starts[::-1]))):
        assert presence.contradicted(peer, Pose()) >= TUNING.proof        # 22 m off
        assert not presence.contradicted(peer, Pose.from_array(truth))


def test_what_a_robot_sees_counts_where_it_may(rng: np.random.Generator) -> None:
    """With the views that its own SLAM tells, in the time of its own clock."""
    views, heard = bent_team()[0]['robot1'], {name: Heard() for name in 'ab'}
    ahead = Pose(2.0, 0.0, 0.0)
    for visible in (False, True):
        session = FusionSession('a', TeamConfig(robots_visible=visible), FusionConfig(),
                                lambda text: None)
        session.begin('a', EPOCHS['robot1'], 0.0)
        for batch in batches(views, EPOCHS['robot1']):
            session.elastic.take_views('a', batch)
        for stamp, pose in zip(views.stamps, views.poses, strict=True):
            here = TimedPose(stamp, Pose.from_array(compose(pose, ahead)), P)
            heard['b'].add_pose(here)
            heard['a'].add_pose(here._replace(pose=Pose.from_array(pose), arrived=stamp))
            heard['b'].late = 0.0
        session.look_around(heard)
        assert bool(session.presence.contradicted('b', Pose())) == visible
        session.look_around(heard)      # every view once


def test_poses_count_only_where_clocks_agree() -> None:
    own, presence = Heard(), Presence()
    for k in range(20):
        own.add_pose(TimedPose(float(k), WAY[k], P, float(k)))
        for peer, late in (('b', 0.0), ('late', 2.0), ('early', -2.0)):
            presence.hear(peer, TimedPose(k - late, WAY[k], P), own, float(k))
    assert presence.contradicted('b', Pose())
    assert not presence.contradicted('late', Pose())
    assert not presence.contradicted('early', Pose())


class AlwaysSure(Matchers):
    """Take any two maps for the same place."""

    def align(self, *grids: object) -> Alignment:
        """Accept the identity."""
        return Alignment(accepted=True, probability=0.99, reason='accepted: alike',
                         T_target_source=Pose(), covariance=1e-4 * np.eye(3))


def alike() -> tuple[FusionSession, Inbox]:
    """Make a robot whose map is like that of its peer."""
    session = FusionSession('a', TeamConfig(), FusionConfig(), lambda text: None,
                            matchers=AlwaysSure())
    inbox = Inbox('a', session, 10 ** 6, lambda kind, reason='': None, lambda: 20.0)
    room = fake_grid(furnished_room())
    for robot, grid in (('a', room), ('b', cut_grid(room, (-1.0, -1.0), (5.0, 7.0)))):
        inbox.heard[robot] = Heard()
        session.begin(robot, Epoch(robot), 0.0)
        session.take_map(robot, SharedMap(grid))
    return session, inbox


def told(session: FusionSession) -> set[str]:
    """Name the kinds of what a robot accepts."""
    return {constraint.kind for constraint in session.refresh({'b'}).constraints}


def test_a_match_that_cannot_be_is_withdrawn_at_once_though_no_map_changes() -> None:
    session, inbox = alike()
    assert session.attempt(0.0) == 'b'
    assert told(session) == {'match'}
    for k, pose in enumerate(WAY):
        for robot in 'ab':
            inbox.keep_pose(robot, lambda k=k, pose=pose: (TimedPose(20.0 + k, pose, P), None))
    assert session.attempt(10.0) == 'b'
    assert told(session) == set()
    assert session.snapshot.words['b'] == 'withdrawn'
    assert 'in one place' in session.snapshot.verdicts['b'].reason
    session.begin('b', Epoch('b', 1), 11.0, keep_map=True)      # of another map nothing is known
    session.attempt(30.0, force=True)
    assert told(session) == {'match'}


def test_a_robot_that_stands_does_not_move_where_headings_wrap() -> None:
    told = Outbox('ab12', 'b', bytes(32))
    assert told.moved(TimedPose(0.0, Pose(1.0, 2.0, np.pi - 1e-3), np.eye(3)))
    assert not told.moved(TimedPose(1.0, Pose(1.0, 2.0, -np.pi + 1e-3), np.eye(3)))
    assert told.moved(TimedPose(2.0, Pose(1.0, 2.0, -np.pi + 0.1), np.eye(3)))


def test_a_node_that_begins_anew_is_told_where_robots_were_and_hands_it_on() -> None:
    there, epochs = Presence(), {robot: Epoch(robot) for robot in 'abc'}
    for pose in WAY:
        for peer in 'ac':
            there.meet(peer, Meeting(pose, pose))
    said = Outbox('ab12', 'b', bytes(32))
    first = said.state(Snapshot(), 0, 0.0)
    assert first is not None and not decode_state(first).whereabouts
    now = Snapshot(whereabouts=there.whereabouts('b', epochs))
    assert said.state(now, 0, 1.0) is None      # it is no reason to speak
    text = said.state(now, 0, 60.0)
    assert text is not None
    heard = decode_state(text).whereabouts
    assert [one.robot for one in heard] == ['a', 'c']
    fresh, _ = alike()
    assert fresh.attempt(0.0) == 'b'
    fresh.take_state('b', TeamState('s', whereabouts=heard[1:]))
    assert fresh.attempt(10.0) is None
    assert told(fresh) == {'match'}     # b has no word on where c was when the robot was there
    fresh.take_state('b', TeamState('s', whereabouts=heard))
    assert fresh.attempt(20.0) == 'b'
    assert told(fresh) == set()
    fresh.take_state('b', TeamState('s'))       # its node begins anew, too, and knows nothing
    (again,) = fresh.refresh({'b'}).whereabouts
    assert (again.robot, again.epochs) == ('b', (Epoch('a'), Epoch('b')))
    assert {*again.places} == {pair[::-1] for pair in heard[0].places}
    fresh.begin('b', Epoch('b', 1), 21.0, keep_map=True)      # of another map nothing is known
    fresh.attempt(40.0, force=True)
    assert told(fresh) == {'match'}
    assert fresh.snapshot.whereabouts == ()


def test_what_is_refused_on_the_maps_of_now_is_said_to_be_doubted_and_less_probable() -> None:
    session, _ = alike()
    session.attempt(0.0)
    assert session.refresh({'b'}).doubted == frozenset()
    session._matchers.align = lambda *grids: replace(
        AlwaysSure().align(), accepted=False, probability=0.2, reason='refused: walls differ')
    session.attempt(10.0, force=True)
    snapshot = session.refresh({'b'})
    assert snapshot.doubted == {'b'}
    assert snapshot.words['b'] == 'kept'
    assert [c.probability for c in snapshot.constraints] == [0.2]


def test_two_sightings_outweigh_a_match_and_one_does_not() -> None:
    session, _ = alike()
    seen = MapConstraint('a', 'b', Pose(5.0, 2.0, 1.0), 0.01 * np.eye(3), kind='sighting')
    session.take_sighting(seen)
    session.attempt(0.0)
    assert told(session) == {'match', 'sighting'}
    session.take_sighting(seen)
    assert session.attempt(10.0) == 'b'
    assert told(session) == {'sighting'}
    assert session.snapshot.own_transforms['b'] == seen.T_target_source
