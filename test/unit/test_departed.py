# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of robots that are gone, and how those who are left agree on it."""

from collections.abc import Iterable
from dataclasses import replace

from helpers import cut_grid, fake_grid, fake_room
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.departed import DepartedRobots
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.members import Team
from somfusion_ros.team.seal import Seal, Sealer
from somfusion_ros.team.shared_map import mark_driven, SharedMap
from test_members import verdict

ROOM = fake_grid(fake_room())
LESS = cut_grid(ROOM, (-1.0, -1.0), (5.0, 7.0))
THERE, NEARBY, FAR = Pose(3.0, 1.0, 0.5), Pose(3.1, 1.0, 0.5), Pose(9.0, 9.0, 1.0)
SECRET, OTHER = 32 * b'd', 32 * b'z'


def constraint(pose: Pose) -> MapConstraint:
    """Make what the robot d, which is gone, had accepted about b."""
    return MapConstraint('b', 'd', pose, np.diag([0.01, 0.01, 1e-4]))


def seal(constraints: Iterable[MapConstraint], number: int = 1, epoch: Epoch = Epoch(),
         secret: bytes = SECRET) -> Seal:
    """Seal what d had accepted, as the word of a number."""
    sealer = Sealer('d', secret)
    sealer._number = number - 1
    sealed = sealer.seal(epoch, constraints)
    assert sealed is not None
    return sealed


def word(pose: Pose, known: int = 9, number: int = 1, epoch: Epoch = Epoch(),
         secret: bytes = SECRET) -> DepartedRobot:
    """Make what a robot says of d, which is gone."""
    said = (constraint(pose),)
    return DepartedRobot('d', known, said, epoch, seal(said, number, epoch, secret))


def memory(name: str, grid: object = None, pose: Pose = THERE, number: int = 1,
           epoch: Epoch = Epoch()) -> tuple[Team, DepartedRobots]:
    """Make a robot that knew d, or did not."""
    team = Team(name)
    departed = DepartedRobots(team)
    if grid is not None:
        team.begin('d', epoch)
        team.update_map('d', SharedMap(grid))
        team.hear('d', [constraint(pose)])
        departed.hear('d', (), word(pose, 9, number, epoch).seal)
    return team, departed


def talk(robots: dict[str, tuple[Team, DepartedRobots]]) -> None:
    """Let robots agree and tell one another what they know."""
    for _, departed in robots.values():
        departed.update(set(robots))
    for name, (_, departed) in robots.items():
        for other, (_, listening) in robots.items():
            if other != name:
                listening.hear(name, departed.known)


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


def test_all_agree_on_the_newest_word_and_on_the_memory_that_knows_most() -> None:
    robots = {'a': memory('a', LESS, FAR, 2), 'b': memory('b', ROOM), 'c': memory('c', ROOM)}
    for _ in range(3):
        talk(robots)
    assert robots['a'][1].sources == {'d': 'b'}
    assert robots['b'][1].sources == robots['c'][1].sources == {}
    for team, departed in robots.values():
        assert team.heard_of('d')[0].T_target_source == FAR
        assert not departed.lies


@pytest.mark.parametrize('names', ['ab', 'ba'])
def test_of_two_that_were_cut_off_the_one_that_heard_the_last_is_believed(names: str) -> None:
    """Also where the robot began another map meanwhile, and then was gone."""
    one, other = names
    robots = {one: memory(one, ROOM, THERE, 7), other: memory(other, LESS, FAR, 8, Epoch('2e', 1))}
    for _ in range(3):
        talk(robots)
    assert robots[one][1].sources == {'d': other}
    for team, departed in robots.values():
        assert team.epochs['d'] == Epoch('2e', 1)
        assert team.heard_of('d')[0].T_target_source == FAR
        assert not departed.lies
    robots[one][0].update_map('d', SharedMap(LESS), lent=True)
    talk(robots)
    assert robots[one][1].known[0].seal == robots[other][1].known[0].seal


@pytest.mark.parametrize('lie', [
    word(FAR, 10 ** 9, 99, secret=OTHER),                                      # its own key
    DepartedRobot('d', 10 ** 9, (constraint(FAR),), Epoch(), word(THERE).seal),  # of other words
    DepartedRobot('d', 10 ** 9, (constraint(FAR),), Epoch(),
                  word(THERE).seal._replace(number=99)),
    DepartedRobot('d', 10 ** 9, (constraint(FAR),), Epoch('2e'), word(THERE).seal),
    DepartedRobot('d', 10 ** 9, (constraint(FAR),))])
def test_no_single_other_makes_up_what_a_robot_said_last(lie: DepartedRobot) -> None:
    team, departed = memory('b', ROOM)
    departed.hear('z', (lie,))
    for _ in range(2):
        departed.update({'z'})
        assert team.heard_of('d')[0].T_target_source == THERE
        assert team.epochs['d'] == Epoch()
        assert departed.known[0].seal == word(THERE).seal


def test_a_key_is_not_handed_over_by_steps() -> None:
    """Who says nearly the same under a key of its own does not become the robot's voice."""
    team, departed = memory('b', LESS)
    for step in range(1, 8):
        departed.hear('z', (word(Pose(3.0 + 0.1 * step, 1.0, 0.5), 10 ** 9, step, secret=OTHER),))
        departed.update({'z'})
    assert team.heard_of('d')[0].T_target_source == THERE


def test_what_a_robot_did_not_seal_does_not_count_once_it_is_gone() -> None:
    team, departed = memory('b', ROOM)
    departed.hear('d', ())                 # its last word was not sealed
    departed.update({'d'})
    assert team.heard_of('d')
    departed.update(set())
    assert not team.heard_of('d')
    departed.hear('a', (word(THERE),))     # but the one before was, by the key that it had
    departed.update({'a'})
    assert team.heard_of('d')[0].T_target_source == THERE


def test_of_a_robot_that_never_sealed_anything_nobody_knows_words() -> None:
    team, departed = memory('b', ROOM)
    departed._seals.clear()
    departed.hear('z', (word(FAR, 10 ** 9, secret=OTHER),))
    for _ in range(2):
        departed.update({'z'})
    assert not team.heard_of('d')
    assert [gone.robot for gone in departed.known] == ['d']     # its map stays


def test_few_seals_of_one_peer_are_checked_at_once() -> None:
    """So that no peer can take the time of others."""
    team, departed = memory('c')
    lies = tuple(replace(word(FAR, 10 ** 9), robot=f'g{k}') for k in range(60))
    with pytest.MonkeyPatch.context() as patch:
        asked = []
        patch.setattr('somfusion_ros.team.seal.verify', lambda *given: asked.append(given))
        departed.hear('z', lies)
        departed.hear('y', lies)
        departed.update({'y', 'z'})
        assert len(asked) == 2


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
    lie = word(NEARBY, 10 ** 9, 9, Epoch('9f'), OTHER)
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
    departed.hear('d', (), seal(team.heard_of('d')))
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
    departed.hear('z', (word(NEARBY, 10 ** 9, 9, Epoch('0f'), OTHER),))
    departed.update({'z'})
    assert team.epochs['d'] == Epoch()
    assert 'd' in team.maps
    assert departed.sources == {}


def test_who_knew_a_robot_believes_no_words_and_no_map_that_contradict_it() -> None:
    """However much of it a liar says that it knows."""
    team, departed = memory('a', LESS, NEARBY)
    elsewhere = fake_grid(fake_room(), T_map_walls=Pose(20.0, 20.0, 1.0))
    departed.hear('z', (word(FAR, 10 ** 9, secret=OTHER),))
    assert departed.update({'b', 'z'}) == [
        ('z', 'z says of d, which is gone, what contradicts what was heard of it')]
    assert departed.update({'b', 'z'}) == []      # it is said once,
    assert [*departed.lies] == ['z']              # and holds
    assert departed.sources == {}
    assert team.heard_of('d')[0].T_target_source == NEARBY
    departed.hear('z', (word(NEARBY, 10 ** 9),))
    departed.hear('y', (word(NEARBY, 10 ** 5),))
    departed.update({'b', 'y', 'z'})
    assert departed.sources == {'d': 'z'}         # the words are true, the map may be another's
    with pytest.raises(ValueError, match='unlike what it told itself'):
        team.update_map('d', SharedMap(elsewhere), lent=True)
    departed.refuse('d')
    assert departed.update({'b', 'y', 'z'}) == [
        ('z', 'z lends a map of d, which is gone, that is unlike what it told itself')]
    assert departed.sources == {'d': 'y'}         # another one is asked
    assert team.update_map('d', SharedMap(ROOM), lent=True)


def test_of_a_robot_whose_map_never_came_others_words_are_believed() -> None:
    team, departed = memory('a')
    team.begin('d', Epoch())
    team.hear('d', [constraint(THERE)])
    departed.hear('z', (word(FAR),))
    departed.update({'z'})
    assert departed.sources == {'d': 'z'}


def test_of_what_a_robot_said_last_that_counts_which_most_heard() -> None:
    """Its last word did not reach all: they agree without it, and one alone changes nothing."""
    team, departed = memory('a', LESS, NEARBY)
    last = word(FAR, secret=OTHER)         # of a node that was started anew
    departed.hear('y', (last,))
    departed.update({'y'})
    assert team.heard_of('d')[0].T_target_source == NEARBY
    departed.hear('z', (last,))
    departed.update({'y', 'z'})
    assert team.heard_of('d')[0].T_target_source == FAR
