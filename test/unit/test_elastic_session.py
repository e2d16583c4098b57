# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A live team bends its maps alike on every robot, whatever happens to the messages."""

from collections.abc import Callable
from dataclasses import replace

from helpers import checkpoint
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import between, compose, inverse, Pose
from somfusion_ros.slam.checkpoint import NOTHING
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond_codec import decode_bonds, encode_bonds, ToldBond
from somfusion_ros.team.elastic_session import ElasticSession
from somfusion_ros.team.fact_reader import FactReader
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.kept_views import encode_kept
from somfusion_ros.team.teller import tell, Teller
from somfusion_ros.team.told_bonds import MOST_AUTHORS, ToldBonds
from somfusion_ros.team.view_facts import Facts
from somfusion_ros.team.view_inbox import ViewInbox
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.view_store import encode_batches, ViewStore
from test_elastic import bent_team

pytestmark = pytest.mark.slow

EPOCHS = {'robot1': Epoch('a1', 0), 'robot2': Epoch('b2', 0)}
OPEN = 0.6     # probability of a verdict that the views turn


def batches(views: ViewSet, epoch: Epoch, size: int = 20, telling: str = 't1') -> list[bytes]:
    """Tell of a path in batches, as a slam_node does."""
    whole = tell(checkpoint(views.stamps, views.poses, views.clouds, views.steps))
    return [batch for k in range(0, len(whole.views), size)
            for batch in encode_batches(epoch, telling, Facts(whole.views[k:k + size]))]


def clock() -> Callable[[], float]:
    """Make a clock that goes on by a minute whenever it is read."""
    now = iter(range(0, 10 ** 9, 60))
    return lambda: float(next(now))


def team() -> tuple[ElasticSession, ElasticSession, dict[str, Pose]]:
    """Two robots that have heard each other's views, and where the verdicts have the maps."""
    views, _, world = bent_team()
    robots = ElasticSession('robot1', clock()), ElasticSession('robot2', clock())
    for session in robots:
        for name, epoch in EPOCHS.items():
            for batch in batches(views[name], epoch):
                session.take_views(name, batch)
    return *robots, world


def verdict(world: dict[str, Pose]) -> Alignment:
    """Return what the grids said: rather yes, but not enough."""
    return Alignment(accepted=False, probability=OPEN, reason='refused: walls agree 60 %',
                     T_target_source=world['robot2'])


def test_views_turn_a_verdict_and_both_robots_bend_alike() -> None:
    one, two, world = team()
    judged = one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    assert judged.accepted
    assert 'views confirm' in judged.reason
    assert two.weigh('robot1', verdict(world), EPOCHS, 0.8).accepted
    assert decode_bonds(two.own_bonds(), 'robot2') == []      # the first name tells the bond
    two.take_bonds('robot1', one.own_bonds())
    told = (decode_bonds(robot._bonds.bytes_of('robot1'), 'robot1')[0] for robot in (one, two))
    for m, n in zip(*(bond.matches for bond in told), strict=True):
        assert np.array_equal(m.R, n.R)       # who tells a bond uses what the bytes say, too
    for session in (one, two):
        session.update(world, EPOCHS, 'robot1')
        assert session.solved == ['robot1', 'robot2']
    first, second = one.draw(), two.draw()
    assert np.array_equal(first.grid.evidence, second.grid.evidence)
    assert first.grid.T_frame_grid == second.grid.T_frame_grid
    assert one.places(None) == two.places(None)
    assert one.draw() is first      # nothing is drawn twice


def test_a_robot_is_where_its_last_view_is() -> None:
    one, _, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    one.update(world, EPOCHS, 'robot1')
    bent = one.places(None)
    step = bent['robot2'].x - world['robot2'].x, bent['robot2'].y - world['robot2'].y
    assert np.hypot(*step) > 0.1
    moved = bent_team()[0]['robot1'].poses + (0.5, 0.0, 0.0)     # the own map moved meanwhile
    there = one.places(moved)
    assert there['robot1'].x - bent['robot1'].x == pytest.approx(-0.5, abs=0.05)
    assert there['robot2'] == bent['robot2']


def test_transforms_to_peers_are_those_of_the_views() -> None:
    one, _, world = team()
    assert one.seen({'robot2': world['robot2']}, world) == {'robot2': world['robot2']}
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    one.update(world, EPOCHS, 'robot1')
    placed = {**one.places(None), 'robot3': Pose(9.0, 9.0, 0.0)}
    seen = one.seen({'robot2': world['robot2'], 'robot3': Pose(1.0, 0.0, 0.0)}, placed)
    assert compose(placed['robot1'], seen['robot2']) == pytest.approx(placed['robot2'], abs=1e-9)
    assert seen['robot3'] == Pose(1.0, 0.0, 0.0)      # of it no views came


def test_new_views_are_solved_in_passing_and_the_whole_at_leisure() -> None:
    """In the end both robots have the same, to the bit, whatever came in which order."""
    _, two, world = team()
    views, _, _ = bent_team()
    early = ElasticSession('robot1', lambda: now[0])
    now, told = [0.0], {name: batches(views[name], EPOCHS[name]) for name in EPOCHS}
    for name, parts in told.items():
        for batch in parts[:-1]:
            early.take_views(name, batch)
    early.weigh('robot2', verdict(world), EPOCHS, 0.8)
    early.update(world, EPOCHS, 'robot1')
    early.draw()
    for name, parts in told.items():
        early.take_views(name, parts[-1])
    early._whole_due = 100.0      # as after a solution of a large team
    now[0] = 50.0
    early.update(world, EPOCHS, 'robot1')
    assert early.solutions == 2
    two.take_bonds('robot1', early.own_bonds())
    two.update(world, EPOCHS, 'robot2')
    two.update(world, EPOCHS, 'robot1')
    there = two.draw()
    for name in EPOCHS:
        assert early._solved[name] == pytest.approx(two._solved[name], abs=0.05)
    for k in range(30):
        now[0] = 101.0 + k
        early.update(world, EPOCHS, 'robot1')
        early.draw()
    assert early.solutions == 3
    assert np.array_equal(early.draw().grid.evidence, there.grid.evidence)
    assert early.places(None) == two.places(None)


def test_doubled_and_disordered_batches_change_nothing() -> None:
    views, _, _ = bent_team()
    told = batches(views['robot1'], EPOCHS['robot1'])
    straight, mixed = ViewStore(), ViewStore()
    for batch in told:
        straight.take(batch)
    for batch in [*reversed(told), *told[:3]]:
        mixed.take(batch)
    assert straight.bytes == mixed.bytes
    assert np.array_equal(straight.views().poses, mixed.views().poses)
    assert mixed.views() is mixed.views()


def test_views_lie_where_loops_that_came_later_put_them() -> None:
    """A robot tells each view once, where it then was; its drift shows when a loop is closed."""
    views, truth, _ = bent_team()
    own, last = views['robot1'], len(views['robot1']) - 1
    loop = Constraint(0, last, between(truth['robot1'][0], truth['robot1'][last]),
                      np.diag([1e-4, 1e-4, 1e-5]))
    told = tell(checkpoint(own.stamps, own.poses, own.clouds, [*own.steps, loop]))
    store, before = ViewStore(), compose(inverse(truth['robot1'][0]), truth['robot1'])
    store.take(*encode_batches(EPOCHS['robot1'], 't', Facts(told.views)))
    assert store.views().poses == pytest.approx(own.poses, abs=1e-4)
    drifted = np.hypot(*(store.views().poses - before)[:, :2].T).max()
    store.take(*encode_batches(EPOCHS['robot1'], 't', Facts(loops=told.loops)))
    settled = np.hypot(*(store.views().poses - before)[:, :2].T).max()
    assert drifted > 0.5
    assert settled < 0.2 * drifted
    assert store.views().poses[0] == pytest.approx(own.poses[0], abs=1e-4)


def test_views_that_were_taken_back_show_nothing() -> None:
    """A robot was carried away: what it saw until it noticed is gone, also where it was told."""
    views, truth, _ = bent_team()
    own, n = views['robot1'], len(views['robot1'])
    whole = checkpoint(own.stamps, own.poses, own.clouds, own.steps)
    teller, store, first = Teller(), ViewStore(), n - 8
    store.take(*encode_batches(EPOCHS['robot1'], 't', teller.more(whole)))
    back = replace(whole, clouds=[*own.clouds[:first], *[NOTHING] * 8])
    more = teller.more(back)
    assert teller.more(back).every == ()
    store.take(*encode_batches(EPOCHS['robot1'], 't', more))
    store.take(*encode_batches(EPOCHS['robot1'], 't', more))
    heard = store.views()
    assert len(heard) == n
    assert [len(cloud.points) > 0 for cloud in heard.clouds] == [k < first for k in range(n)]
    drawn = draw_joint({'a': heard}, {'a': truth['robot1']}, 0.05)
    alone = draw_joint({'a': heard}, {'a': truth['robot1'][:first]}, 0.05)
    assert np.array_equal(drawn.evidence, alone.evidence)
    late = ViewStore()      # a late joiner gets the views as they are now
    late.take(*encode_batches(EPOCHS['robot1'], 't', tell(back)))
    assert [len(c.points) for c in late.views().clouds] == [len(c.points) for c in heard.clouds]


def test_what_others_hand_on_of_a_robot_that_is_back_is_too_late() -> None:
    """It goes on with its map, tells its path anew, and tells no view twice."""
    views, absent = bent_team()[0]['robot1'], {'robot1'}
    session = ElasticSession('robot3', clock())
    inbox = ViewInbox(session, {}, lambda kind, reason: None, lambda: 0.0, lambda: absent)
    before, now = (batches(views, EPOCHS['robot1'], telling=telling) for telling in 'ab')
    inbox.keep_kept('robot1', encode_kept(before, b''))
    absent.clear()
    for batch in now:
        inbox.keep_batch('robot1', batch)
    inbox.keep_kept('robot1', encode_kept(before, b''))
    inbox.drain()
    assert session.kept('robot1') == encode_kept(now, b'')


def test_bonds_of_robots_that_nobody_knows_any_more_are_forgotten() -> None:
    bonds = ToldBonds('robot3', FactReader())
    for number in range(3 * MOST_AUTHORS):
        bonds.take(f'liar{number}', encode_bonds(()))
    assert len(bonds._bonds) == MOST_AUTHORS
    for epochs in (EPOCHS, {}):
        bonds.take('robot1', encode_bonds(()))
        bonds.refute({}, {}, epochs, 1.0, 1.0)
    assert not bonds.bytes_of('robot1')
    bonds.take('robot2', encode_bonds(()))      # before its state
    bonds.refute({}, {}, {}, 1.0, 1.0)
    assert bonds.bytes_of('robot2')


def test_a_bond_is_judged_again_where_views_moved() -> None:
    """A loop that a robot closes moves its views, and with them where a bond has the maps."""
    bonds, views = ToldBonds('robot2', FactReader()), {**bent_team()[0]}
    match = InterMatch('robot1', 0, 'robot2', 0, np.zeros(3), np.eye(3))
    bonds.take('robot1', encode_bonds([ToldBond(
        'robot1', 'robot2', (EPOCHS['robot1'], EPOCHS['robot2']), (match,))]))
    there = Pose.from_array(compose(views['robot2'].poses[0], inverse(views['robot1'].poses[0])))
    answers = []
    for moved in (0.0, 3.0):
        views['robot2'] = replace(views['robot2'], poses=views['robot2'].poses + (moved, 0.0, 0.0))
        answers.append(bonds.refute(views, {'robot1': there}, EPOCHS, 1.0, 0.4))
    assert answers == [{}, {'robot1': pytest.approx(3.0)}]


def test_who_comes_later_gets_what_a_robot_that_is_gone_told() -> None:
    """robot1 is gone; robot2 hands its views and bonds on, and a third one draws the same map."""
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    two.take_bonds('robot1', one.own_bonds())
    third, unusable = ElasticSession('robot3', clock()), []
    inbox = ViewInbox(third, {}, lambda kind, reason: unusable.append(reason), lambda: 0.0)
    inbox.keep_kept('robot1', two.kept('robot1'))
    for batch in batches(bent_team()[0]['robot2'], EPOCHS['robot2']):
        inbox.keep_batch('robot2', batch)
    inbox.drain()
    for session in (two, third):
        session.update(world, EPOCHS, 'robot1')
        assert session.solved == ['robot1', 'robot2']
    assert np.array_equal(two.draw().grid.evidence, third.draw().grid.evidence)
    assert two.kept('robot9') == b''
    for data in (b'', two.kept('robot1')[:-1], b'\xff' * 9):
        inbox.keep_kept('robot1', data)
    assert len(unusable) == 3
    assert two.kept('robot1') == third.kept('robot1')


def test_what_was_said_of_a_map_lapses_with_it() -> None:
    one, _, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    one.update(world, EPOCHS, 'robot1')
    assert one.solved
    one.update(world, {**EPOCHS, 'robot2': Epoch('b2', 1)}, 'robot1')
    assert one.solved == []
    assert one.draw() is None
    assert one.places(None) == {}


def test_a_restarted_robot_tells_all_anew() -> None:
    views, _, _ = bent_team()
    store = ViewStore()
    for batch in batches(views['robot1'], EPOCHS['robot1']):
        store.take(batch)
    store.take(batches(views['robot2'], EPOCHS['robot1'], telling='t2')[0])
    assert len(store.views()) == 20
    assert store.views().poses == pytest.approx(views['robot2'].poses[:20], abs=1e-4)


def test_bonds_of_others_and_garbage_are_refused() -> None:
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    told = one.own_bonds()
    with pytest.raises(ValueError, match='not its own'):
        two.take_bonds('robot3', told)
    for data in (b'', told[:30], told[:-1], told + b'x', b'\xff' * 100, b'\x02\x00\x00\x00{}'):
        with pytest.raises(ValueError):
            two.take_bonds('robot1', data)
    for data in (b'', b'\x01', b'\x01\x04\x02a1.0t1\x01\xff\xff', b'\xff' * 50):
        with pytest.raises(ValueError):
            two.take_views('robot1', data)
    assert two.bytes_of('robot1') > 10_000      # what came before is still there
