# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a liar says of views and bonds: it costs little, bends nobody, and is counted."""

from dataclasses import replace
import time
import tracemalloc

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import between, inverse, Pose
from somfusion_ros.simulation.chaos.view_lies import absurd_batches, bonds_with, flood, stolen
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team import view_store
from somfusion_ros.team.bond_codec import decode_bonds, encode_bonds, ToldBond
from somfusion_ros.team.bond_message import BondMessage
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.elastic_session import ElasticSession
from somfusion_ros.team.fact import LOOP
from somfusion_ros.team.graph import solve
from somfusion_ros.team.heard import from_sighting, Heard, TimedPose, TUNING
from somfusion_ros.team.joint_drawing import JointDrawing
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.kept_views import encode_kept
from somfusion_ros.team.sightings import Sighting, Sightings
from somfusion_ros.team.view_facts import decode_view, encode_taken_back, Facts
from somfusion_ros.team.view_inbox import ViewInbox
from somfusion_ros.team.view_store import decode_batch, EACH, encode_batches, FEW, ViewStore
from test_elastic import bent_team
from test_elastic_session import batches, EPOCHS, team, verdict

pytestmark = pytest.mark.slow

GOOD = np.diag([1e-4, 1e-4, 1e-6])
LIAR = Epoch('11a7')
BYTES_PER_BEAM = 210      # of a robot's views at most, once they are unpacked
LONGEST = 2.0      # [s] of CPU; a tenth of it on a machine of its own


def test_absurd_views_are_refused_and_what_came_before_stays(rng: np.random.Generator) -> None:
    one, _, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    before, refused = one.bytes_of('robot1'), 0
    for _ in range(5):
        for batch in absurd_batches(LIAR, rng):
            try:
                one.take_views('aliar', batch)
            except ValueError as error:
                assert '\n' not in str(error)
                refused += 1
    assert refused >= 10
    assert one.bytes_of('robot1') == before
    one.update({**world, 'aliar': Pose()}, {**EPOCHS, 'aliar': LIAR}, 'robot1')
    assert one.solved == ['robot1', 'robot2']


def test_views_of_64_robots_are_kept_and_no_more() -> None:
    session = ElasticSession('robot1', lambda: 0.0)
    batch = encode_batches(LIAR, 't', Facts((), flood().loops[:1], ()))[0]
    for number in range(64):
        session.take_views(f'robot{number}', batch)
    with pytest.raises(ValueError, match='more than 64'):
        session.take_views('one_more', batch)
    session.take_views('robot63', batch)


def test_a_flood_of_facts_is_refused_before_it_is_read() -> None:
    """Of 75000 loops between two views most cost no more than a look at them."""
    batches = encode_batches(LIAR, 't', Facts((), flood().loops * 50, ()))
    store, start = ViewStore(), time.process_time()
    store.take(batches[0])
    for batch in batches[1:]:
        with pytest.raises(ValueError, match='facts of one kind'):
            store.take(batch)
    assert time.process_time() - start < LONGEST
    assert store.bytes <= 88 * (FEW[LOOP] + EACH[LOOP])


def test_views_that_wait_are_bounded_in_bytes() -> None:
    """However fast and large they come while the worker is busy."""
    counts: list[str] = []
    inbox = ViewInbox(ElasticSession('a', lambda: 0.0), {},
                      lambda kind, reason='': counts.append(kind), lambda: 0.0)
    for _ in range(60):
        inbox.keep_batch('z', bytes(10 ** 6))
    assert counts == 20 * ['views_of_z_unusable']      # what waits is 40 MB
    inbox.drain()
    inbox.keep_batch('z', bytes(10 ** 6))
    inbox.drain()
    assert len(counts) == 61       # all others are no views, and there is room again


def test_beams_are_counted_before_they_are_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    data = batches(bent_team()[0]['robot1'], EPOCHS['robot1'])[0]
    facts = [fact for fact in decode_batch(data)[2] if fact.beams]
    monkeypatch.setattr(view_store, 'MOST_BEAMS', 3 * facts[0].beams)
    store = ViewStore()
    with pytest.raises(ValueError, match='beams'):
        store.take(data)
    assert 0 < len(store.views().poses) <= 3


def test_the_memory_of_a_robots_views_has_a_bound_that_a_liar_reaches(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """At a two-hundredth of it: what it is told, unpacked, and worked out to be drawn."""
    most = view_store.MOST_BEAMS // 200
    monkeypatch.setattr(view_store, 'MOST_BEAMS', most)
    seen = [decode_view(fact) for fact in decode_batch(one_path()[0])[2]]
    tracemalloc.start()
    store, refused = ViewStore(), ''
    while not refused:
        first = len(store.views())
        facts = tuple(replace(
            seen[k % len(seen)], number=k, stamp=float(k), off=np.zeros(3),
            step=Constraint(k - 1, k, np.array([0.01, 0.0, 0.0]), GOOD) if k else None).encode()
            for k in range(first, first + 50))
        try:
            for batch in encode_batches(LIAR, 't', Facts(facts)):
                store.take(batch)
        except ValueError as error:
            refused = str(error)
    for cloud in store.views().clouds:
        assert len(cloud.outline.rim) + len(cloud.outline.hits)
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert 'beams' in refused
    assert store._beams > 0.99 * most
    assert 0.1 < held / (BYTES_PER_BEAM * most) < 1.0


def test_two_bonds_with_one_robot_are_refused(rng: np.random.Generator) -> None:
    """They could not be sorted, and stopped the worker: found by chaos."""
    match = InterMatch('aliar', 0, 'robot1', 0, np.zeros(3), GOOD)
    twice = [ToldBond('aliar', 'robot1', (LIAR, EPOCHS['robot1']), (match,))] * 2
    with pytest.raises(ValueError, match='two bonds with one robot'):
        decode_bonds(encode_bonds(twice), 'aliar')
    one, _, _ = team()
    with pytest.raises(ValueError):
        one.take_bonds('aliar', bonds_with('aliar', LIAR, EPOCHS, rng, 2))


def test_what_a_robot_took_back_can_be_stolen_too() -> None:
    """A campaign in which a robot was carried ended there."""
    fact = encode_taken_back(range(3, 9))
    batch, = encode_batches(EPOCHS['robot1'], 't', Facts(taken_back=(fact,)))
    assert decode_batch(stolen(batch, LIAR))[2] == [fact]


def test_a_liar_with_stolen_views_hardly_bends_two_who_agree(rng: np.random.Generator) -> None:
    one, _, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    one.update(world, EPOCHS, 'robot1')
    alone = one.places(None)
    for batch in one_path():
        one.take_views('aliar', stolen(batch, LIAR))
    one.take_bonds('aliar', bonds_with('aliar', LIAR, EPOCHS, rng))
    for _ in range(20):
        one.update({**world, 'aliar': Pose(3.0, 1.0, 0.5)}, {**EPOCHS, 'aliar': LIAR}, 'robot1')
        one.draw()
    for robot, pose in alone.items():
        assert one.places(None)[robot][:2] == pytest.approx(pose[:2], abs=0.5)


@pytest.mark.parametrize('asked', [True, False])
@pytest.mark.parametrize('off', [0.0, 0.2, 0.6, 2.0])
def test_a_bond_that_the_other_robot_finds_elsewhere_counts_for_nobody(off: float, asked: bool
                                                                       ) -> None:
    """By its own views, or by where it accepts the map if they were not asked."""
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    if asked:
        two.weigh('robot1', verdict(world), EPOCHS, 0.8)
    bond, = decode_bonds(one.own_bonds(), 'robot1')
    lie = encode_bonds([bond._replace(matches=tuple(
        replace(m, z=m.z + (off, 0.0, 0.0)) for m in bond.matches))])
    there = {'robot1': Pose.from_array(inverse(world['robot2']))}
    for robot in (one, two):
        robot.take_bonds('robot1', lie)
    refuted, most = two.refute(there, EPOCHS), 0.4 if asked else 1.0
    assert [*refuted] == (['robot1'] if off > most else [])
    one.hear_refuted('robot2', refuted)
    for robot in (one, two):
        robot.update(world, EPOCHS, 'robot1', {('robot1', 'robot2'), ('robot2', 'robot1')})
        assert bool(robot.solved) == (off < most)
    for only in (('robot1', 'robot2'), ('robot2', 'robot1')):
        one.update(world, EPOCHS, 'robot1', {only})
        assert one.solved == []      # nor does one of a pair that one of them does not accept


def test_what_robots_call_false_is_forgotten_with_them() -> None:
    """Names that come and go left six kilobytes each."""
    one, _, _ = team()
    for k in range(100):
        one.hear_refuted(f'g{k}', [f'h{k}_{j}' for j in range(64)])
    one.hear_refuted('robot2', ['robot1'])
    one.refute({}, EPOCHS)
    assert one._bonds.refuted == {'robot1': frozenset(), 'robot2': frozenset({'robot1'})}


@pytest.mark.parametrize(('off', 'least', 'most'), [(0.35, 0.4, 0.8), (0.6, 0.0, 0.05)])
def test_how_far_a_liar_with_a_true_map_moves_two_who_agree(off: float, least: float, most: float
                                                            ) -> None:
    """By twice what each of them lets pass, as all of 256 matches agree: no more than 0.8 m."""
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    two.weigh('robot1', verdict(world), EPOCHS, 0.8)
    honest, = decode_bonds(one.own_bonds(), 'robot1')
    two.take_bonds('robot1', one.own_bonds())
    epochs, views = {**EPOCHS, 'aliar': LIAR}, len(one.views_of(('robot1',), EPOCHS)['robot1'])
    lies = encode_bonds([ToldBond('aliar', robot, (LIAR, EPOCHS[robot]), matches) for
                         robot, matches in (
        ('robot1', 3 * tuple(InterMatch('aliar', k, 'robot1', k, np.array([off, 0.0, 0.0]), GOOD)
                             for k in range(views))),
        ('robot2', 4 * tuple(replace(m, target='aliar', z=m.z - (off, 0.0, 0.0), R=GOOD)
                             for m in honest.matches)))])
    world = {**world, 'aliar': world['robot1']}
    apart = {}
    for lying in (False, True):
        for robot, name in ((one, 'robot1'), (two, 'robot2')):
            if lying:
                for batch in one_path():
                    robot.take_views('aliar', stolen(batch, LIAR))
                robot.take_bonds('aliar', lies)
                found = replace(verdict(world), T_target_source=world[name])
                assert robot.weigh('aliar', found, epochs, 0.8).accepted
        refuted = {name: robot.refute({
            peer: Pose.from_array(between(world[name], world[peer]))
            for peer in world.keys() - {name}}, epochs)
            for robot, name in ((one, 'robot1'), (two, 'robot2'))}
        one.hear_refuted('robot2', refuted['robot2'])
        for _ in range(30):
            one.update(world, epochs, 'robot1')
            one.draw()
        places = one.places(None)
        apart[lying] = between(places['robot1'], places['robot2'])
    moved = np.hypot(*(apart[True] - apart[False])[:2])
    assert least <= moved <= most
    assert [*refuted.values()] == [{}, {}] or [*refuted['robot1']] == ['aliar']


def one_path() -> list[bytes]:
    """Tell the path of robot1."""
    return batches(bent_team()[0]['robot1'], EPOCHS['robot1'])


def test_views_that_lie_absurdly_far_do_not_stop_the_drawing() -> None:
    one, _, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    seen = decode_view(decode_batch(one_path()[0])[2][0])
    step = Constraint(0, 1, np.array([9e4, 0.0, 0.0]), 1e-6 * np.eye(3))
    facts = tuple(replace(seen, number=k, stamp=float(k), off=np.zeros(3), step=made).encode()
                  for k, made in ((0, None), (1, step)))
    for batch in encode_batches(LIAR, 't', Facts(facts)):
        one.take_views('aliar', batch)
    match = InterMatch('aliar', 0, 'robot1', 0, np.zeros(3), GOOD)
    one.take_bonds('aliar', encode_bonds([
        ToldBond('aliar', 'robot1', (LIAR, EPOCHS['robot1']), (match,))]))
    one.update({**world, 'aliar': Pose()}, {**EPOCHS, 'aliar': LIAR}, 'robot1')
    tracemalloc.start()
    drawn = one.draw()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert drawn is not None
    assert peak < 50 * 2 ** 20      # it is known to be too large before it is made


def test_of_many_views_far_away_and_few_of_the_own_robot_the_own_ones_are_drawn() -> None:
    robots = {}
    for name in ('robot1', 'zliar'):
        store = ViewStore()
        store.take(one_path()[0])
        robots[name] = store.views()
    poses = {'robot1': robots['robot1'].poses[:2], 'zliar': robots['zliar'].poses + (9e4, 9e4, 0)}
    words: list[str] = []
    drawing = JointDrawing(0.05, 10.0, lambda: 0.0, say=words.append, own='robot1')
    grid = drawing.draw(robots, poses).grid
    assert words
    assert all('views of zliar are left out' in word for word in words)
    assert grid.known.any()
    assert np.abs(grid.points(grid.known)).max() < 100.0


def test_where_no_bond_joins_a_robot_all_still_place_it_alike() -> None:
    """The rigid place of one was that of when each solved last: found by chaos."""
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    two.take_bonds('robot1', one.own_bonds())
    epochs, sessions = {**EPOCHS, 'robot3': Epoch('c3')}, (one, two)
    for session in sessions:
        for batch in one_path():
            session.take_views('robot3', stolen(batch, epochs['robot3']))
    for session, first in zip(sessions, (Pose(0.4, 0.1, 0.1), Pose(0.1, 0.3, 0.0))):
        session.update({**world, 'robot3': first}, epochs, 'robot1')
        for _ in range(3):
            session.update({**world, 'robot3': Pose(0.2, 0.2, 0.05)}, epochs, 'robot1')
            session.draw()
        for _ in range(20):
            session.update({**world, 'robot3': Pose(0.2, 0.2, 0.05)}, epochs, 'robot1')
            session.draw()
    assert one.places(None) == two.places(None)
    assert np.array_equal(one.draw().grid.evidence, two.draw().grid.evidence)


def test_who_contradicts_itself_does_not_outvote_one_honest_word() -> None:
    """In a single cycle all words are alike; a liar's, at probability 1, won: found by chaos."""
    b, c = Pose(2.0, 0.0, 0.2), Pose(4.0, 1.0, -0.3)
    honest = [MapConstraint('a', 'b', b, GOOD, 0.99, author='a'),
              MapConstraint('a', 'b', b, GOOD, 0.99, author='b'),
              MapConstraint('a', 'c', c, GOOD, 0.9, author='c')]
    said = [MapConstraint(robot, 'z', Pose(float(k), -7.0, 1.0 - k), GOOD, 1.0, kind, author='z')
            for k, robot in enumerate('abc') for kind in ('match', 'sighting')]
    said += [MapConstraint('c', 'z', Pose(9.0, 9.0, 2.0), GOOD, 1.0, 'sighting', author='z')]
    solution = solve('abcz', honest + said)
    assert solution.group_of('a')['c'][:2] == pytest.approx(c[:2], abs=0.1)
    assert {one.constraint.author for one in solution.dropped} == {'z'}


def test_a_pose_between_poses_is_less_sure_and_one_from_before_a_step_back_is_none() -> None:
    heard = Heard()
    for stamp, theta in ((10.0, 0.0), (11.0, 0.8)):
        heard.add_pose(TimedPose(stamp, Pose(stamp - 10.0, 0.0, theta), GOOD))
    middle, end, after = (heard.pose_at(stamp) for stamp in (10.5, 11.0, 11.4))
    assert middle is not None
    assert end is not None
    assert after is not None
    assert middle.covariance[2, 2] == pytest.approx(GOOD[2, 2] + (TUNING.uneven * 0.8) ** 2)
    assert np.allclose(end.covariance, GOOD)
    assert np.allclose(after.covariance, GOOD + 0.16 * np.eye(3))
    heard.add_pose(TimedPose(3.0, Pose(1.1, 0.0, 0.8), GOOD))      # the clock was set back
    assert heard.pose_at(10.5) is None
    assert heard.pose_at(3.0) is not None
    assert heard.pose_at(2.9) is None       # where it was before that is not known


def test_a_pose_in_a_map_that_began_tells_nothing_of_the_time_before() -> None:
    """A SLAM that goes on from an earlier state has the robot where it stood then."""
    heard = Heard()
    heard.add_pose(TimedPose(10.0, Pose(9.0, 4.0, 0.0), GOOD))
    heard.forget_poses()
    heard.add_pose(TimedPose(12.0, Pose(1.0, 3.0, 0.0), GOOD))
    assert heard.pose_at(11.5) is None
    after = heard.pose_at(12.4)
    assert after is not None
    assert after.pose == Pose(1.0, 3.0, 0.0)


def test_a_robot_between_two_poses_that_are_the_same_may_have_turned_away_and_back() -> None:
    heard = Heard()
    for stamp in (10.0, 11.0):
        heard.add_pose(TimedPose(stamp, Pose(), GOOD))
    middle = heard.pose_at(10.5)
    assert middle is not None
    assert np.sqrt(middle.covariance[2, 2] - GOOD[2, 2]) == pytest.approx(0.5 * TUNING.swerve)


@given(st.floats(0.1, TUNING.longest_gap), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8),
       st.floats(0.0, 1.0))
def test_a_pose_between_poses_allows_for_any_way_that_a_robot_can_turn(
        span: float, rates: list[float], share: float) -> None:
    """At up to 1 rad/s: 3.5 sigma hold what the harness allows."""
    times = np.linspace(0.0, span, len(rates) + 1)
    headings = np.concatenate([[0.0], np.cumsum(np.array(rates) * np.diff(times))])
    heard = Heard()
    for stamp, theta in ((0.0, 0.0), (span, headings[-1])):
        heard.add_pose(TimedPose(stamp, Pose(0.0, 0.0, float(theta)), 1e-12 * np.eye(3)))
    between_them = heard.pose_at(share * span)
    assert between_them is not None
    off = between_them.pose.theta - np.interp(share * span, times, headings)
    assert abs(off) <= 3.5 * np.sqrt(between_them.covariance[2, 2]) + 1e-9


def test_a_clock_that_is_ahead_is_known_by_stamps_of_the_future() -> None:
    heard = Heard()
    assert heard.future(1e6, 0.0) == 0.0       # it does not know its own time yet
    heard.add_pose(TimedPose(50.0, Pose(), GOOD, 7.0))
    assert heard.future(50.0 + 2.0 * TUNING.ahead, 7.2) == pytest.approx(2.0 * TUNING.ahead - 0.2)
    assert heard.future(50.0 + 0.9 * TUNING.ahead, 7.2) == 0.0
    assert heard.future(0.0, 7.2) == 0.0
    assert heard.future(90.0, 9.0) == 0.0      # its own SLAM is silent
    heard.add_pose(TimedPose(51.0, Pose(), GOOD, 12.0))     # one that a load delayed by 4 s
    assert heard.future(55.5, 12.1) == 0.0
    assert heard.future(57.1, 12.1) == pytest.approx(2.0)


@pytest.mark.parametrize(('step', 'late', 'used'), [
    (0.0, 0.0, True), (0.0, 4.0, True), (0.0, 20.0, False), (-20.0, 0.0, False),
    (-3600.0, 0.0, False), (20.0, 0.0, False)])
def test_a_sighting_counts_only_where_both_poses_are_of_one_time(step: float, late: float,
                                                                 used: bool) -> None:
    """
    The peer's poses are there, but of another time: a clock was set, or they came late.

    The peer stands, and says no new pose after the step: so chaos found it.
    """
    heard, taken, counted = {'a': Heard(), 'b': Heard()}, [], []
    sightings = Sightings('a', heard, taken.append, lambda kind, reason='': counted.append(kind))
    for k in range(100):
        stamp = 5000.0 + k
        heard['b'].add_pose(TimedPose(stamp + step, Pose(0.5 * k), GOOD, 70.0 + k + late))
    now = 5090.0
    heard['a'].add_pose(TimedPose(now - 0.1, Pose(), GOOD, 159.9))
    heard['a'].add_pose(TimedPose(now + 0.1, Pose(), GOOD, 160.1))
    sightings.add(Sighting('b', now, Pose(1.0), GOOD, 160.0))
    sightings.settle(164.0)
    assert (len(taken), counted) == ((1, []) if used else (0, ['encounters_unusable']))


def test_a_sighting_is_the_less_sure_the_more_the_clocks_may_differ() -> None:
    """A peer whose clock is two seconds off drove on for so long."""
    own = TimedPose(50.0, Pose(1.0, 2.0, 0.5), GOOD, 7.0)
    sigmas = [np.sqrt(np.diag(from_sighting(own, Pose(2.0), GOOD, TimedPose(
        50.0, Pose(-3.0, 1.0, 2.0), GOOD, 7.0 + late))[1])) for late in (0.0, 2.0, -2.0)]
    assert sigmas[0].max() < 0.1
    assert min(sigmas[1].min(), sigmas[2].min()) > 1.9 * TUNING.speed


def test_bonds_that_are_handed_on_late_do_not_replace_what_a_robot_says_itself() -> None:
    """A robot was back, and had none any more, when its old ones came from a keeper: by chaos."""
    one, two, world = team()
    one.weigh('robot2', verdict(world), EPOCHS, 0.8)
    inbox = ViewInbox(two, {}, lambda kind, reason='': None, lambda: 0.0)
    kept = encode_kept([], one.own_bonds())
    for of_itself, holds in ((None, True), (encode_bonds([]), False)):
        if of_itself is not None:
            inbox.keep_bonds('robot1', BondMessage('s', 1, of_itself).encode())
        inbox.keep_kept('robot1', kept)
        inbox.drain()
        two.update(world, EPOCHS, 'robot1')
        assert bool(two.solved) == holds


def test_a_bond_that_contradicts_the_accepted_pairs_counts_for_nothing(
        rng: np.random.Generator) -> None:
    """Two robots without a bond of their own were placed by a liar's with each: by chaos."""
    one, _, world = team()
    for batch in one_path():
        one.take_views('aliar', stolen(batch, LIAR))
    one.take_bonds('aliar', bonds_with('aliar', LIAR, EPOCHS, rng))
    for _ in range(20):
        one.update({**world, 'aliar': Pose(3.0, 1.0, 0.5)}, {**EPOCHS, 'aliar': LIAR}, 'robot1')
        one.draw()
    assert one.solved == []
