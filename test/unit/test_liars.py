# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a liar can do to a team, and what it cannot: bounded time, one voice, no ghosts."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
import time
import tracemalloc

from helpers import fake_grid, fake_room, furnished_room, pose_error
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, MAP, STATE
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.constraint import MapConstraint, sane_covariance, turned
from somfusion_ros.team.departed import DepartedRobots
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.graph import solve
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.inbox import Inbox
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.map_codec import key_message, MapEncoder
from somfusion_ros.team.members import Team
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.seal import Sealer
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells, MOST_WALLS, SharedMap
from somfusion_ros.team.state_codec import (decode_state, encode_state, fitting,
                                            MAX_CONSTRAINTS, TeamState)
from somfusion_ros.team.voices import one_voice_each

ROOM = fake_grid(fake_room())
GOOD = np.diag([1e-4, 1e-4, 1e-6])
LONGEST = 1.0      # [s] of CPU; a tenth of it on a machine of its own, 43 s before it was bounded
MEGABYTE = 2 ** 20


def honest_team(count: int, rng: np.random.Generator) -> tuple[dict[str, Pose],
                                                               list[MapConstraint]]:
    """Place robots, each of which matched the next four."""
    truth = {f'r{k:02d}': Pose(*rng.uniform(-50, 50, 2), rng.uniform(-3, 3))
             for k in range(count)}
    names = list(truth)
    said = [MapConstraint(a, b, Pose.from_array(
        between(truth[a], truth[b]) + rng.normal(0, (0.02, 0.02, 0.003))), GOOD, 0.95, author=a)
        for k, a in enumerate(names) for b in names[k + 1:k + 5]]
    return truth, said


def lies(liar: str, peers: Iterable[str], rng: np.random.Generator) -> list[MapConstraint]:
    """Say four wrong things about every peer, as many as a state can hold."""
    return [MapConstraint(liar, peer, Pose(*rng.uniform(-20, 20, 2), rng.uniform(-3, 3)), GOOD,
                          1.0, kind, author=liar)
            for peer in peers for kind in ('match', 'sighting', 'sighting', 'sighting')][
                :MAX_CONSTRAINTS]


def cpu(job: object, *args: object) -> tuple[float, object]:
    """Time [s] of CPU that a job takes, the better of two, and its result."""
    took = []
    for _ in range(2):
        start = time.process_time()
        result = job(*args)
        took.append(time.process_time() - start)
    return min(took), result


def test_256_sightings_of_a_liar_end_in_time_and_move_nobody(rng: np.random.Generator) -> None:
    truth, said = honest_team(24, rng)
    liar = 'r23'
    fake = lies(liar, list(truth)[:-1], rng) * 3
    took, solution = cpu(solve, truth, said + fake[:MAX_CONSTRAINTS])
    assert took < LONGEST
    group = solution.group_of('r00')
    for robot in list(truth)[:-1]:
        assert pose_error(group[robot], between(truth['r00'], truth[robot]))[0] < 0.5
    assert any(f'all that {liar} says is left out' in one.reason for one in solution.dropped)


@pytest.mark.parametrize('liar', ['r00', 'r63'])
def test_a_liar_among_64_who_all_know_one_another_ends_in_time_and_moves_nobody(
        liar: str, rng: np.random.Generator) -> None:
    truth, _ = honest_team(64, rng)
    said = [MapConstraint(a, b, Pose.from_array(
        between(truth[a], truth[b]) + rng.normal(0, (0.02, 0.02, 0.003))
        + (author == liar) * rng.uniform(-9, 9, 3)), GOOD, 0.95, author=author)
        for a, b in combinations(truth, 2) for author in (a, b)]
    took, solution = cpu(solve, truth, said)
    assert took < LONGEST
    group, first = solution.group_of('r01'), truth['r01']
    for robot in truth.keys() - {liar}:
        assert pose_error(Pose.from_array(between(group['r01'], group[robot])),
                          between(first, truth[robot]))[0] < 0.5
    assert liar in {one.constraint.author for one in solution.dropped}
    assert all(liar in one.constraint.robots for one in solution.dropped)


@pytest.mark.parametrize('off', [0.4, 5.0])
@pytest.mark.parametrize('liars', [1, 2, 9])
def test_no_number_of_liars_moves_two_robots_that_say_the_same(liars: int, off: float) -> None:
    """They agree with one another, and say of robot b that it lies aside: a little, or far."""
    T, names = Pose(3.0, 1.0, 0.5), [f'liar{k}' for k in range(liars)]
    honest = [MapConstraint('a', 'b', T, GOOD, 0.95, author=author) for author in 'ab']
    there = {'a': Pose(), 'b': Pose.from_array(compose(T, (off, 0.0, 0.0))),
             **dict.fromkeys(names, Pose(1.0, 1.0, 0.0))}
    said = [MapConstraint(liar, other, Pose.from_array(between(there[liar], there[other])), GOOD,
                          1.0, author=liar) for liar in names for other in there if other != liar]
    alone, solution = solve('ab', honest), solve(there, honest + said)
    assert solution.group_of('a')['b'] == alone.group_of('a')['b']
    assert off > 1.0 or {*names} <= solution.group_of('a').keys()
    assert all(one.constraint.author in names for one in solution.dropped)
    assert solution.dropped or off < 1.0


def test_1750_ghosts_are_nobody() -> None:
    team = Team('a')
    for robot in 'ab':
        team.update_map(robot, SharedMap(ROOM))
    ghosts = [MapConstraint('b', f'g{k}', Pose(1, 2, 3), GOOD) for k in range(1750)]
    team.hear('b', [MapConstraint('a', 'b', Pose(1, 0, 0), GOOD), *ghosts])
    took, solution = cpu(team.solution)
    assert took < LONGEST
    assert set(solution.group_of('a')) == {'a', 'b'}


def test_absent_robots_that_only_others_tell_of_are_bounded_and_nobody() -> None:
    team = Team('a')
    team.update_map('a', SharedMap(ROOM))
    departed = DepartedRobots(team)
    for owner in 'bcdef':
        team.begin(owner, Epoch())
        departed.hear(owner, tuple(DepartedRobot(f'{owner}{k}', 10 ** 9, tuple(
            MapConstraint(f'{owner}{k}', f'{owner}{j}', Pose(1, 2, 3), GOOD) for j in range(20)
            if j != k)) for k in range(64)))
    departed.update(set('bcdef'))
    took, solution = cpu(team.solution)
    assert took < LONGEST
    assert len(team.epochs) <= 6 + 64
    assert all(len(group) == 1 for group in solution.groups)


def test_a_match_and_a_sighting_of_one_liar_do_not_outvote_two_honest_robots() -> None:
    """The liar z says twice where it is in a; a and b agree that it is elsewhere."""
    there, wrong, b_there = Pose(3, 1, 0.5), Pose(-6, 2, -1.0), Pose(2.0, 0.0, 0.2)
    said = [MapConstraint('a', 'b', b_there, GOOD, 0.95, author='a'),
            MapConstraint('a', 'z', there, GOOD, 0.95, author='a'),
            MapConstraint('b', 'z', Pose.from_array(between(b_there, there)), GOOD, 0.95,
                          author='b'),
            *[MapConstraint('a', 'z', wrong, GOOD, 1.0, kind, author='z')
              for kind in ('match', 'sighting', 'sighting')]]
    solution = solve('abz', said)
    assert pose_error(solution.group_of('a')['z'], there)[0] < 0.1
    assert {one.constraint.author for one in solution.dropped} == {'z'}


def test_one_voice_is_as_sure_as_its_parts_together() -> None:
    match = MapConstraint('a', 'b', Pose(1, 2, 0.5), GOOD, author='a')
    seen = turned(MapConstraint('a', 'b', Pose(1.1, 2, 0.5), 4 * GOOD, kind='sighting',
                                author='a'))
    (voice,), wrong = one_voice_each([match, seen, seen])
    assert not wrong
    assert voice.kind == 'match'
    assert np.allclose(np.linalg.inv(voice.covariance), np.linalg.inv(GOOD) + np.linalg.inv(
        turned(seen).covariance), rtol=1e-6)
    assert 1.0 < voice.T_target_source.x < 1.1


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))
def test_a_constraint_turned_twice_says_the_same(x: float, y: float, theta: float) -> None:
    one = MapConstraint('a', 'b', Pose(x, y, theta), np.diag([0.01, 0.04, 1e-4]))
    again = turned(turned(one))
    assert np.allclose(again.T_target_source, one.T_target_source)
    assert np.allclose(again.covariance, one.covariance, atol=1e-9)
    assert turned(one).robots == ('b', 'a')


@pytest.mark.parametrize('bad', [
    np.zeros((3, 3)), -GOOD, np.full((3, 3), np.nan), np.diag([1e9, 1.0, 1.0]),
    np.diag([1.0, 1.0, 1e4]), np.ones((3, 3)), np.eye(2), 5e-324 * np.eye(3),
    np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1]]),
    np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]])])
def test_covariances_that_are_none_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match='covariance'):
        sane_covariance(bad)


@pytest.mark.parametrize('name', ['', 'a b', 'a/', '/a', '1a', 'a//b', 'ä', '\ud800', 'a\n',
                                  'a__b', 'r' * 65, 'a/1', None, 7, b'a', '../../etc'])
def test_what_is_no_ros_name_is_no_robot(name: object) -> None:
    with pytest.raises(ValueError, match='no name of a robot'):
        robot_name(name)


@pytest.mark.parametrize('name', ['robot1', 'fleet/r5', '_a', 'R' * 64])
def test_ros_names_are_robots(name: str) -> None:
    assert robot_name(name) == name


def walls(side: int, share: float) -> MapCells:
    """Draw a map of which a share is wall."""
    cells = np.zeros((side, side), np.int8)
    cells[:int(side * share)] = 100
    return MapCells(cells, 0.05, Pose())


def test_a_map_of_walls_alone_is_refused_before_it_costs_anything() -> None:
    """15 kB on the wire cost 39 s and 10.6 GB."""
    encoder = MapEncoder()
    encoder.encode(walls(4000, 1.0))
    assert len(encoder.key) < 20000
    tracemalloc.start()
    start = time.process_time()
    with pytest.raises(ValueError, match='cells of wall'):
        SharedMap.from_cells(walls(4000, 1.0))
    assert time.process_time() - start < 10.0
    assert tracemalloc.get_traced_memory()[1] < 200 * MEGABYTE
    tracemalloc.stop()
    with pytest.raises(ValueError, match='cells of wall'):
        SharedMap.from_cells(walls(4000, MOST_WALLS / 4000 ** 2 + 0.01))
    assert SharedMap.from_cells(walls(100, 0.9)).grid.occupied.any()   # a small map costs nothing


def test_nobody_frees_a_wall_that_the_own_robot_sees() -> None:
    """The liar says that it drove through every wall, and that all is free."""
    own = fake_grid(fake_room())
    free = fake_grid(fake_room())
    free.evidence[:] = 1.0
    everywhere = {'z': free.points(free.evidence > 0)}
    grids, poses = {'a': own, 'z': free}, {'a': Pose(), 'z': Pose()}
    erased = merge_grids(grids, poses, driven=everywhere, robot_radius=0.35)
    kept = merge_grids(grids, poses, driven=everywhere, robot_radius=0.35, own='a')
    corners = own.points(own.occupied)
    outer = corners[(np.abs(corners[:, 1]) < 0.1)]   # one wall from end to end
    assert len(outer) > 50
    assert erased.evidence[tuple(erased.point_to_cell(outer).T)].min() == 1.0
    assert kept.evidence[tuple(kept.point_to_cell(outer).T)].max() <= 0.0


def test_a_liar_with_a_small_map_far_away_does_not_make_the_drawing_large() -> None:
    """Within what a map may be: 700 x 700 m were 200 million cells, 1.2 GB while it is drawn."""
    words: list[str] = []
    session = FusionSession('a', TeamConfig(), FusionConfig(), words.append)
    session.begin('a', Epoch('1f'), 0.0)
    session.begin('z', Epoch('2e'), 0.0)
    session.take_map('a', SharedMap(fake_grid(furnished_room())))
    session.take_map('z', SharedMap(fake_grid(fake_room())))
    session.take_state('z', TeamState('s', (MapConstraint(
        'a', 'z', Pose(700.0, 700.0, 0.0), GOOD, epochs=(Epoch('1f'), Epoch('2e'))),)))
    assert {*session.refresh({'z'}).world('a')} == {'a', 'z'}
    tracemalloc.start()
    drawn = session.draw()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert drawn is not None
    assert drawn.evidence.size < 10 ** 6
    assert peak < 20 * MEGABYTE
    assert any(word.startswith('z is left out of the global map') for word in words)


def test_where_a_peer_has_driven_counts_once_the_own_match_accepted_it() -> None:
    """Nor is it shown where a body is before that."""
    grid = fake_grid(furnished_room())
    free = Grid(np.ones_like(grid.evidence), grid.resolution, grid.T_frame_grid)
    everywhere, drawn = SharedMap(free, free.points(free.known)), {}
    for accepted in (False, True):
        session = FusionSession('c', TeamConfig(), FusionConfig(), lambda text: None)
        for name, shared in (('a', SharedMap(grid)), ('z', everywhere), ('c', SharedMap(ROOM))):
            session.begin(name, Epoch('1f'), 0.0)
            session.take_map(name, shared)
        session.take_state('a', TeamState('s', tuple(MapConstraint(
            'a', other, Pose(), GOOD, epochs=(Epoch('1f'), Epoch('1f'))) for other in 'cz')))
        if accepted:
            session.take_sighting(MapConstraint('c', 'z', Pose(), GOOD, kind='sighting'))
        assert {*session.refresh({'a', 'z'}).world('c')} == {'a', 'c', 'z'}
        assert ('z' in session.snapshot.own_transforms) == accepted
        drawn[accepted] = session.draw()
    walls = grid.points(grid.occupied)
    freed = [np.mean(one.evidence[tuple(one.point_to_cell(walls).T)] > 0.9)
             for one in (drawn[False], drawn[True])]
    assert freed[0] < 0.2      # where both c and z see that it is free
    assert freed[1] > freed[0] + 0.3      # but no wall that the own robot sees


def station(counts: list[str], clock: list[float]) -> tuple[Inbox, FusionSession]:
    """Make what robot a hears its peers with."""
    session = FusionSession('a', TeamConfig(), FusionConfig(), lambda text: None,
                            count=lambda kind, reason: counts.append(kind))
    inbox = Inbox('a', session, 10 ** 6, lambda kind, reason='': counts.append(kind),
                  lambda: clock[0])
    inbox.heard['a'] = Heard()
    session.begin('a', Epoch('1f'), 0.0)
    session.take_map('a', SharedMap(fake_grid(furnished_room())))
    return inbox, session


def state(number: int, **parts: object) -> str:
    """Write a state of a peer."""
    return encode_state(TeamState('ab12', number=number, epoch=Epoch('2e'), **parts))


def test_the_memory_of_a_peer_has_a_bound_that_it_cannot_pass() -> None:
    """
    Per peer: one waiting message per channel, one key, one waiting change, one map.

    At most 2 bytes of a stream per cell, twice, and 6 bytes per cell of the map: 10 MB for the
    million cells of this test.
    """
    clock, counts = [0.0], []
    inbox, session = station(counts, clock)
    inbox.heard['z'] = Heard()
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 100, (1000, 1000)).astype(np.int8)
    noise[noise >= 65] = -1
    tracemalloc.start()
    for number in range(12):
        clock[0] += 1.0
        inbox.keep('z', STATE, state(number, constraints=tuple(
            MapConstraint('z', f'g{k}', Pose(), GOOD) for k in range(MAX_CONSTRAINTS))), 0,
            decode_state)
        encoder = MapEncoder()
        encoder.encode(MapCells(np.roll(noise, number), 0.05, Pose()), Epoch('2e'))
        for channel in (MAP, CHANGES):
            inbox.keep('z', channel, encoder.key, len(encoder.key), bytes)
        inbox.drain()
        session.refresh({'z'})
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert 6 * MEGABYTE < held < 12 * MEGABYTE      # it is reached, and not passed
    assert session.epoch_of('z') == Epoch('2e')


@pytest.mark.parametrize('x, stamp, variance', [
    (np.nan, 1.0, 1.0), (np.inf, 1.0, 1.0), (1e300, 1.0, 1.0), (0.0, np.nan, 1.0),
    (0.0, -np.inf, 1.0), (0.0, 1.0, np.nan)])
def test_a_pose_that_is_none_is_counted_and_noted_nowhere(x: float, stamp: float, variance: float
                                                          ) -> None:
    """Were it told in turn as where that robot was, nobody could read the honest robot's state."""
    clock, counts = [0.0], []
    inbox, session = station(counts, clock)
    inbox.heard['z'] = Heard()
    inbox.keep('z', STATE, state(1), 0, decode_state)
    inbox.drain()
    here = TimedPose(1.0, Pose(), GOOD)
    inbox.keep_pose('a', lambda: (here, None))
    bad = TimedPose(stamp, Pose(x, 0.0, 0.0), variance * GOOD)
    inbox.keep_pose('z', lambda: (bad, Epoch('2e')))
    assert counts == ['pose_of_z_unusable']
    assert not inbox.heard['z'].poses
    assert session.refresh({'z'}).whereabouts == ()
    inbox.keep_pose('z', lambda: (here, Epoch('2e')))
    assert session.refresh({'z'}).whereabouts


def test_what_a_robot_knows_always_fits_into_its_state() -> None:
    """Of robots that are gone and had said much, as of a liar's ghosts, what counts is told."""
    team = Team('a')
    team.update_map('a', SharedMap(ROOM))
    for robot in ('b', 'c', 'd'):
        team.update_map(robot, SharedMap(ROOM))
        team.hear(robot, [MapConstraint(robot, f'g{k}', Pose(), GOOD) for k in range(250)]
                  + [MapConstraint('a', robot, Pose(), GOOD)])
    gone = DepartedRobots(team)
    for robot in ('b', 'c', 'd'):
        gone.hear(robot, (), Sealer(robot, 32 * b'k').seal(Epoch(), team.heard_of(robot)))
    gone.update(())
    assert [robot.constraints[0].robots for robot in gone.known] == [('a', n) for n in 'bcd']
    many = tuple(MapConstraint('a' * 64, f'{k:064}'.replace('0', 'b'), Pose(1.0 / 3, 1.0 / 7, 0.1),
                               GOOD, 1.0 / 3, kind, (Epoch('z' * 32, 10 ** 8), Epoch('z' * 32)))
                 for k in range(300) for kind in ('match', 'sighting'))
    few = Sealer('h', 32 * b'k').seal(Epoch(), many[:9])
    told = decode_state(encode_state(fitting(TeamState('ab12', many, (*(
        DepartedRobot(f'g{k}', 9, many) for k in range(40)), DepartedRobot(
            'h', 9, many[:9], Epoch(), few), *(
        DepartedRobot(f'k{k}', 9, many[:100]) for k in range(40)))))))
    assert len(told.constraints) == MAX_CONSTRAINTS
    assert {one.kind for one in told.constraints} == {'match'}
    assert len(told.departed) == 64
    assert {one.robot: one.seal for one in told.departed if one.seal} == {'h': few}
    assert {len(one.constraints) for one in told.departed} == {0, 9, 100}


def test_a_lie_about_a_robot_that_is_gone_is_counted_and_its_author_suspected() -> None:
    """Words that it did not say, and a map that is not like its own."""
    clock, counts = [0.0], []
    inbox, session = station(counts, clock)
    for robot in 'dz':
        inbox.heard[robot] = Heard()
    said = (MapConstraint('a', 'd', Pose(1, 2, 0.3), GOOD, epochs=(Epoch('1f'), Epoch('2e'))),)
    epoch = Epoch('2e')
    seal = Sealer('d', 32 * b'd').seal(epoch, said)
    inbox.keep('d', STATE, state(1, constraints=said, seal=seal), 0, decode_state)
    encoder = MapEncoder()
    encoder.encode(SharedMap(fake_grid(fake_room())).to_cells(), epoch)
    inbox.keep('d', MAP, encoder.key, len(encoder.key), bytes)
    inbox.drain()
    session.refresh({'d'})
    lie = (replace(said[0], T_target_source=Pose(9, 9, 1.0)),)
    inbox.keep('z', STATE, state(1, departed=(DepartedRobot('d', 10 ** 9, lie, epoch, seal),)), 0,
               decode_state)
    inbox.drain()
    assert {*session.refresh({'z'}).suspected} == {'z'}
    assert counts == ['state_of_z_contradicts_absent']
    inbox.keep('z', STATE, state(2, departed=(DepartedRobot('d', 10 ** 9, said, epoch, seal),)), 0,
               decode_state)
    inbox.drain()
    assert session.refresh({'z'}).sources == {'d': 'z'}
    key = key_message(SharedMap(fake_grid(fake_room(), T_map_walls=Pose(20, 20, 1))).to_cells(),
                      epoch)
    inbox.keep('d', MAP, key, len(key), bytes)
    inbox.drain()
    assert {*session.refresh({'z'}).suspected} == {'z'}
    assert not session.snapshot.sources
    assert counts[1:] == ['map_of_d_unusable', 'state_of_z_contradicts_absent']


def test_a_map_that_is_late_does_not_replace_a_newer_one() -> None:
    """Found by chaos: a doubled key came after its successor, and nothing was sent after it."""
    clock, counts = [0.0], []
    inbox, session = station(counts, clock)
    inbox.heard['z'] = Heard()
    inbox.keep('z', STATE, state(1), 0, decode_state)
    encoder, keys = MapEncoder(), []
    for share in (0.1, 0.2):
        cells = walls(60, share)
        encoder.encode(cells._replace(T_frame_grid=Pose(share / 7.0)), Epoch('2e'))
        keys.append(encoder.key)
    assert keys[0] != keys[1]
    for key in (keys[0], keys[1], keys[0]):
        inbox.keep('z', MAP, key, len(key), bytes)
        inbox.drain()
    assert np.array_equal(session.shown_maps()['z'].grid.to_occupancy(), cells.values)
    again = state(1).replace('ab12', 'cd34')
    inbox.keep('z', STATE, again, 0, decode_state)
    encoder = MapEncoder()
    encoder.encode(walls(60, 0.3), Epoch('2e'))
    inbox.keep('z', MAP, encoder.key, len(encoder.key), bytes)
    inbox.drain()
    assert np.array_equal(session.shown_maps()['z'].grid.to_occupancy(), walls(60, 0.3).values)
    assert not counts


def test_a_state_that_is_late_or_doubled_changes_nothing_and_is_counted() -> None:
    clock, counts = [0.0], []
    inbox, session = station(counts, clock)
    inbox.heard['z'] = Heard()
    placed = (MapConstraint('a', 'z', Pose(1, 2, 0.3), GOOD, epochs=(Epoch('1f'), Epoch('2e'))),)
    for number, said in ((5, placed), (4, ()), (5, ()), (0, ())):
        inbox.keep('z', STATE, state(number, constraints=said), 0, decode_state)
        inbox.drain()
    assert set(session.refresh({'z'}).solution.group_of('a')) == {'a', 'z'}
    inbox.keep('z', STATE, state(6), 0, decode_state)
    inbox.drain()
    assert set(session.refresh({'z'}).solution.group_of('a')) == {'a'}
    assert counts == 3 * ['state_of_z_late']


def test_a_liar_that_joins_two_groups_is_named_after_a_while() -> None:
    """It says where a and d are, which neither of them says; d is joined by nothing else."""
    clock, counted = [0.0], list[str]()
    session = FusionSession('a', TeamConfig(), FusionConfig(), lambda text: None,
                            lambda: clock[0], count=lambda kind, reason: counted.append(kind))
    for robot in 'adz':
        session.begin(robot, Epoch('1f'), 0.0)
        session.take_map(robot, SharedMap(fake_grid(furnished_room())))
    said = tuple(MapConstraint('z', robot, Pose(float(k), 1.0), GOOD,
                               epochs=(Epoch('1f'), Epoch('1f'))) for k, robot in enumerate('ad'))
    session.take_state('z', TeamState('s', said))
    session.take_state('d', TeamState('t'))
    for clock[0] in (0.0, 20.0, 40.0, 60.0):
        snapshot = session.refresh({'d', 'z'})
        assert {*snapshot.world('a')} == {*'adz'}
        assert {*snapshot.suspected} == ({*'dz'} if clock[0] > 30.0 else set())
    assert counted == 2 * ['joined_by_z_alone']     # once for d and for z
    assert snapshot.suspected['d'].startswith('d is joined to a only by what z says alone')
