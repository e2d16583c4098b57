# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of robots that are gone, and how those who are left agree on it."""

from helpers import cut_grid, fake_grid, fake_room
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.departed import DepartedRobot, DepartedRobots
from somfusion_ros.team.members import Team
from somfusion_ros.team.shared_map import mark_driven, SharedMap
from test_members import verdict

ROOM = fake_grid(fake_room())
LESS = cut_grid(ROOM, (-1.0, -1.0), (5.0, 7.0))
THERE, NEARBY = Pose(3.0, 1.0, 0.5), Pose(3.1, 1.0, 0.5)


def constraint(pose: Pose) -> MapConstraint:
    """Make what the robot d, which is gone, had accepted about b."""
    return MapConstraint('b', 'd', pose, np.diag([0.01, 0.01, 1e-4]))


def memory(name: str, grid: object = None, pose: Pose = THERE) -> tuple[Team, DepartedRobots]:
    """Make a robot that knew d, or did not."""
    team = Team(name)
    if grid is not None:
        team.update_map('d', SharedMap(grid))
        team.hear('d', [constraint(pose)])
    return team, DepartedRobots(team)


def test_who_is_there_is_not_kept() -> None:
    _, departed = memory('b', ROOM)
    departed.update({'b', 'd'})
    assert departed.known == ()
    departed.update({'b'})
    assert [gone.robot for gone in departed.known] == ['d']
    assert set(departed.maps()) == {'d'}


def test_a_late_joiner_asks_for_the_map_and_takes_the_constraints() -> None:
    _, old = memory('b', ROOM)
    old.update({'b', 'c'})
    team, new = memory('c')
    team.begin('b', Epoch())
    new.hear('b', old.known)
    new.update({'b'})
    assert new.sources == {'d': 'b'}
    assert set(team.solution().group_of('d')) == {'d'}   # hearsay, until its map is here
    team.update_map('d', SharedMap(ROOM))
    new.update({'b'})
    assert set(team.solution().group_of('d')) == {'b', 'd'}
    assert new.sources == {}
    assert [gone.robot for gone in new.known] == ['d']


def test_all_agree_on_the_memory_that_knows_most_and_then_on_the_first_name() -> None:
    robots = {'a': memory('a', LESS, NEARBY), 'b': memory('b', ROOM),
              'c': memory('c', ROOM, NEARBY)}
    for _ in range(2):
        for _, departed in robots.values():
            departed.update(set('abc'))
        for name, (_, departed) in robots.items():
            for other, (_, listening) in robots.items():
                if other != name:
                    listening.hear(name, departed.known)
    for _, departed in robots.values():
        departed.update(set('abc'))
    assert robots['a'][1].sources == {'d': 'b'}
    assert robots['b'][1].sources == robots['c'][1].sources == {}
    for team, _ in robots.values():
        assert team.heard_of('d')[0].T_target_source == THERE


def test_nothing_is_believed_about_oneself_or_from_who_is_gone() -> None:
    team, departed = memory('c')
    about_me = MapConstraint('b', 'c', THERE, np.eye(3))
    departed.hear('b', (DepartedRobot('c', 10 ** 6, (about_me,)),))
    departed.hear('e', (DepartedRobot('d', 10 ** 6, (constraint(THERE),)),))
    departed.update({'b'})
    assert departed.sources == {}
    assert team.solution().groups == ({'c': Pose()},)


def test_a_kept_map_is_handed_on_bit_by_bit() -> None:
    cells = mark_driven(SharedMap(ROOM).to_cells(), [(1.0, 1.0), (2.0, 1.5)])
    again = SharedMap.from_cells(cells).to_cells()
    assert np.array_equal(again.values, cells.values)
    assert again[1:] == cells[1:]


def test_of_several_words_on_which_map_it_was_the_one_that_most_say_counts() -> None:
    """A liar alone does not move a robot that is gone; it left while b and c knew it."""
    robots = {name: memory(name, ROOM) for name in 'bc'}
    robots['a'] = memory('a')
    lie = DepartedRobot('d', 10 ** 9, (constraint(NEARBY),), Epoch('9f'))
    for name, (_, departed) in robots.items():
        for other, (_, listening) in robots.items():
            departed.update(set('abcz'))
            if other != name:
                listening.hear(name, departed.known)
        departed.hear('z', (lie,))
    for team, departed in robots.values():
        departed.update(set('abcz'))
        assert team.epochs['d'] == Epoch()
        assert set(departed.sources.values()) <= {'b', 'c'}


def test_a_robot_that_is_gone_without_a_map_is_forgotten() -> None:
    team, departed = memory('b')
    team.begin('d', Epoch())
    team.begin('b', Epoch())
    team.hear('d', [constraint(THERE)])
    departed.update({'b', 'd'})
    assert set(team.solution().group_of('b')) == {'b', 'd'}
    departed.update({'b'})
    assert team.solution().groups == ({'b': Pose()},)
    assert team.heard_of('d') == ()


@pytest.mark.parametrize('kinds', [('match',), 5 * ('sighting',)])
def test_words_of_a_robot_that_left_lapse_as_a_peer_begins_another_map(kinds: tuple[str, ...]
                                                                       ) -> None:
    """They would have it where it was, against what is matched now."""
    team, departed = memory('a', ROOM)
    for robot in 'ab':
        team.update_map(robot, SharedMap(ROOM))
    team.hear('d', [MapConstraint(robot, 'd', pose, np.diag([1e-4, 1e-4, 1e-6]), 0.99, kind)
                    for robot, pose in (('a', THERE), ('b', Pose())) for kind in kinds])
    departed.update({'b'})
    assert np.allclose(team.solution().group_of('a')['b'], THERE)      # through d
    team.begin('b', Epoch('2e'))
    team.update_map('b', SharedMap(LESS))
    team.record('b', verdict(NEARBY), *team.grids_of('b'), 0.0)
    departed.update({'b'})
    solution = team.solution()
    assert np.allclose(solution.group_of('a')['b'], NEARBY)
    assert np.allclose(solution.group_of('a')['d'], THERE)
    assert not solution.dropped
    assert [gone.robot for gone in departed.known] == ['d']


def test_who_knew_a_robot_believes_no_single_other() -> None:
    """A liar that speaks before the honest ones do would else make them drop what they know."""
    team, departed = memory('b', ROOM)
    departed.hear('z', (DepartedRobot('d', 10 ** 9, (constraint(NEARBY),), Epoch('0f')),))
    departed.update({'z'})
    assert team.epochs['d'] == Epoch()
    assert 'd' in team.maps
    assert departed.sources == {}


def test_who_knew_a_robot_believes_no_words_and_no_map_that_contradict_it() -> None:
    """However much of it a liar says that it knows."""
    team, departed = memory('a', LESS, NEARBY)
    elsewhere = fake_grid(fake_room(), T_map_walls=Pose(20.0, 20.0, 1.0))
    lie = DepartedRobot('d', 10 ** 9, (constraint(Pose(9.0, 9.0, 1.0)),))
    departed.hear('z', (lie,))
    assert departed.update({'b', 'z'}) == [
        'z says of d, which is gone, what contradicts what was heard of it']
    assert departed.update({'b', 'z'}) == []      # it is said once
    assert departed.sources == {}
    assert team.heard_of('d')[0].T_target_source == NEARBY
    departed.hear('z', (DepartedRobot('d', 10 ** 9, (constraint(NEARBY),)),))
    departed.update({'b', 'z'})
    assert departed.sources == {'d': 'z'}         # the words are true, the map may be another's
    with pytest.raises(ValueError, match='unlike what it told itself'):
        team.update_map('d', SharedMap(elsewhere), lent=True)
    assert team.update_map('d', SharedMap(ROOM), lent=True)


def test_of_a_robot_whose_map_never_came_others_words_are_believed() -> None:
    team, departed = memory('a')
    team.begin('d', Epoch())
    team.hear('d', [constraint(THERE)])
    departed.hear('z', (DepartedRobot('d', 9, (constraint(Pose(9.0, 9.0, 1.0)),)),))
    departed.update({'z'})
    assert departed.sources == {'d': 'z'}


def test_of_what_a_robot_said_last_that_counts_which_most_heard() -> None:
    """Its last word did not reach all: they agree without it, and one alone changes nothing."""
    team, departed = memory('a', LESS, NEARBY)
    last = DepartedRobot('d', 9, (constraint(Pose(9.0, 9.0, 1.0)),))
    departed.hear('y', (last,))
    departed.update({'y'})
    assert team.heard_of('d')[0].T_target_source == NEARBY
    departed.hear('z', (last,))
    departed.update({'y', 'z'})
    assert team.heard_of('d')[0].T_target_source == Pose(9.0, 9.0, 1.0)
