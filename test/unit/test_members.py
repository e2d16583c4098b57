# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A live team: pairs only when due, hysteresis, reaching others through peers, restarts."""

from dataclasses import replace

from helpers import cut_grid, fake_grid, fake_room, pose_error
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import Alignment, RunnerUp
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.map_change import begun_anew, change
from somfusion_ros.team.members import Team
from somfusion_ros.team.pair_history import (NEAR_REFUSALS, PairHistory, REFUSALS, same_pose,
                                             TUNING)
from somfusion_ros.team.shared_map import SharedMap

ROOM = fake_grid(fake_room())
HALF = cut_grid(ROOM, (-1.0, -1.0), (4.0, 7.0))
THERE, ELSEWHERE = Pose(3.0, 1.0, 0.5), Pose(-4.0, 2.0, -2.0)
NEARLY_THERE = Pose(3.05, 1.02, 0.51)


def copy_of(grid: Grid) -> Grid:
    """Make another object with the same content, as every message does."""
    return Grid(grid.evidence.copy(), grid.resolution, grid.T_frame_grid)


def verdict(pose: Pose | None, probability: float = 0.97, rival: float = 0.1) -> Alignment:
    """Make an alignment that is accepted at 0.95, with a rival somewhere else."""
    return Alignment(accepted=probability >= 0.95, probability=probability,
                     reason=f'probability {probability}', T_target_source=pose,
                     covariance=np.diag([0.01, 0.01, 1e-4]), runner_up=RunnerUp(Pose(), rival))


def told(pair: PairHistory, *verdicts: Alignment) -> list[str]:
    """Return a pair verdicts and return what it made of them."""
    return [pair.record(v, ROOM, ROOM, 0.0) for v in verdicts]


def test_change_is_the_share_of_walls_that_are_new_or_gone() -> None:
    assert change(ROOM, copy_of(ROOM)) == 0.0
    assert change(ROOM, HALF) == pytest.approx(change(HALF, ROOM))
    share = 1.0 - HALF.occupied.sum() / ROOM.occupied.sum()
    assert change(HALF, ROOM) == pytest.approx(share, abs=0.02)
    assert change(Grid(np.zeros((3, 3)), 0.05), ROOM) == 1.0


def test_change_looks_at_places_not_at_cells_of_the_array() -> None:
    padded = Grid(np.pad(ROOM.evidence, 37), ROOM.resolution, Pose.from_array(
        compose(ROOM.T_frame_grid, (-37 * 0.05, -37 * 0.05, 0.0))))
    assert change(ROOM, padded) == 0.0
    moved = Grid(ROOM.evidence, ROOM.resolution, Pose.from_array(
        compose((1.0, 0.0, 0.0), ROOM.T_frame_grid)))
    assert change(ROOM, moved) > 0.3


def test_a_pair_is_due_once_and_then_only_after_a_change() -> None:
    pair = PairHistory()
    assert pair.due(HALF, ROOM, 0.0, 0.1)
    pair.record(verdict(None, 0.0), HALF, ROOM, 0.0)
    assert not pair.due(HALF, ROOM, 1e6, 0.1)
    assert not pair.due(copy_of(HALF), copy_of(ROOM), 1e6, 0.1)
    assert pair.due(ROOM, ROOM, 1.0, 0.1)


def test_small_changes_count_after_a_while() -> None:
    pair, slightly = PairHistory(), cut_grid(ROOM, (-1.0, -1.0), (7.7, 7.0))
    assert 0.01 < change(slightly, ROOM) < 0.3
    pair.record(verdict(None, 0.0), ROOM, slightly, 100.0)
    assert not pair.due(ROOM, ROOM, 101.0, 0.5)
    assert pair.due(ROOM, ROOM, 101.0 + TUNING.soon, 0.5)
    slow = Alignment(accepted=False, probability=0.0, reason='refused',
                     seconds={'all': 2.0 * TUNING.soon})
    pair.record(slow, ROOM, slightly, 200.0)
    assert not pair.due(ROOM, ROOM, 201.0 + TUNING.soon, 0.5)
    assert pair.due(ROOM, ROOM, 201.0 + 2.0 * TUNING.soon * TUNING.time_share, 0.5)


def test_same_pose_is_judged_at_the_walls() -> None:
    assert same_pose(THERE, NEARLY_THERE, ROOM)
    assert not same_pose(THERE, ELSEWHERE, ROOM)
    assert not same_pose(THERE, Pose(3.0, 1.0, 0.7), ROOM)
    far = Grid(ROOM.evidence, ROOM.resolution, Pose(50.0, 0.0, 0.0))
    assert not same_pose(THERE, Pose(3.0, 1.0, 0.52), far)   # 0.02 rad at 50 m is 1 m


def test_refused_is_not_held() -> None:
    pair = PairHistory()
    assert told(pair, verdict(THERE, 0.5), verdict(None, 0.0)) == ['refused', 'refused']
    assert pair.held is None


def test_the_same_pose_follows_smoothly() -> None:
    pair = PairHistory()
    assert told(pair, verdict(THERE), verdict(NEARLY_THERE, 0.96)) == ['accepted', 'updated']
    assert pair.held.T_target_source == NEARLY_THERE


def test_a_pose_that_moves_by_more_than_a_step_is_followed_in_steps() -> None:
    pair, moved = PairHistory(), Pose(3.3, 1.2, 0.5)
    assert told(pair, verdict(THERE), verdict(moved)) == ['accepted', 'updated']
    first = pair.held.T_target_source
    assert pose_error(first, THERE)[0] == pytest.approx(TUNING.step_distance)
    assert not pair.settled
    assert pair.due(ROOM, ROOM, TUNING.soon, 0.1)
    assert told(pair, *[verdict(moved)] * 3) == ['updated'] * 3
    assert pair.held.T_target_source == moved
    assert pair.settled


def test_a_refusal_on_the_way_to_another_pose_is_no_reason_to_ask_again() -> None:
    """The maps stay as they are, and so would the answer, until it was withdrawn."""
    pair, moved = PairHistory(), Pose(3.3, 1.2, 0.5)
    told(pair, verdict(THERE), verdict(moved))
    assert told(pair, verdict(moved, 0.9)) == ['kept']
    assert not pair.due(ROOM, ROOM, 2.0 * TUNING.soon, 0.1)


def test_a_pose_that_is_replaced_on_the_way_to_another_is_not_on_the_way() -> None:
    pair, elsewhere = PairHistory(), Pose(-8.0, 3.0, 2.0)
    told(pair, verdict(THERE), verdict(Pose(3.3, 1.2, 0.5)))
    assert told(pair, *[verdict(elsewhere, 0.99)] * 2) == ['kept', 'replaced']
    assert pair.settled


def test_another_pose_must_be_clearly_better_twice_in_a_row() -> None:
    pair = PairHistory()
    better, worse = verdict(ELSEWHERE, 0.97), verdict(ELSEWHERE, 0.96, rival=0.95)
    assert told(pair, verdict(THERE), worse, worse, worse) == ['accepted'] + 3 * ['kept']
    assert told(pair, better, verdict(THERE), better) == ['kept', 'updated', 'kept']
    assert pair.held.T_target_source == THERE
    assert told(pair, better) == ['replaced']
    assert pair.held.T_target_source == ELSEWHERE


def test_a_rival_is_looked_at_again_though_no_map_changes() -> None:
    pair = PairHistory()
    told(pair, verdict(THERE), verdict(ELSEWHERE))
    assert not pair.settled
    assert not pair.due(ROOM, ROOM, 0.9 * TUNING.soon, 0.1)
    assert pair.due(ROOM, ROOM, TUNING.soon, 0.1)
    assert told(pair, verdict(ELSEWHERE)) == ['replaced']
    assert not pair.due(ROOM, ROOM, 1e6, 0.1)


def test_two_different_rivals_do_not_confirm_one_another() -> None:
    pair = PairHistory()
    told(pair, verdict(THERE), verdict(ELSEWHERE, 0.999), verdict(Pose(9, 9, 1), 0.999))
    assert pair.held.T_target_source == THERE


def test_clear_refusals_in_a_row_withdraw_a_verdict() -> None:
    pair = PairHistory()
    doubts = [verdict(ELSEWHERE, 0.1)] * (REFUSALS - 1)
    told(pair, verdict(THERE), *doubts)
    assert pair.held is not None
    told(pair, verdict(THERE), *doubts)   # an acceptance in between begins the count anew
    assert pair.held is not None
    assert told(pair, verdict(THERE, 0.1)) == ['withdrawn']
    assert pair.held is None


def test_nearly_accepted_at_the_same_pose_is_no_doubt() -> None:
    pair = PairHistory()
    assert set(told(pair, verdict(THERE), *[verdict(NEARLY_THERE, 0.9)] * 10)[1:]) == {'kept'}


def test_nearly_accepted_again_and_again_is_not_kept_for_ever() -> None:
    pair = PairHistory()
    words = told(pair, verdict(THERE), *[verdict(NEARLY_THERE, 0.9)] * NEAR_REFUSALS)
    assert words[-1] == 'withdrawn'
    assert set(words[1:-1]) == {'kept'}
    assert pair.held is None


def test_a_clear_refusal_on_maps_that_stay_as_they_are_withdraws_in_the_end() -> None:
    """The map of a robot doubled, and then the robot stopped."""
    pair, now = PairHistory(), 0.0
    pair.record(verdict(THERE), ROOM, ROOM, now)
    pair.record(verdict(None, 0.0), ROOM, HALF, now)
    assert pair.doubted
    assert pair.probability == 0.0   # the peers are told how likely it is now
    for _ in range(REFUSALS - 1):
        assert pair.held is not None
        now += TUNING.soon
        assert pair.due(ROOM, HALF, now, 0.1)
        pair.record(verdict(None, 0.0), ROOM, HALF, now)
    assert pair.held is None
    assert not pair.due(ROOM, HALF, now + 1e6, 0.1)


def shared(grid: Grid) -> SharedMap:
    """Make a robot's map that came in a message of its own."""
    return SharedMap(copy_of(grid))


def said(owner: str, peer: str, T_owner_peer: Pose, kind: str = 'match') -> MapConstraint:
    """Make a constraint as it comes over the wire."""
    return MapConstraint(owner, peer, T_owner_peer, np.diag([0.01, 0.01, 1e-4]), 0.9, kind)


def full_team(name: str = 'b') -> Team:
    """Make a team of a, b and c in which every map is known."""
    team = Team(name)
    for robot in 'abc':
        team.update_map(robot, shared(ROOM))
    return team


def test_nothing_can_be_matched_before_the_own_map_came() -> None:
    team = Team('b')
    team.update_map('a', shared(ROOM))
    assert team.peers() == []
    assert team.solution().groups == ({'a': Pose()}, {'b': Pose()})


def test_maps_are_compared_for_change() -> None:
    team = full_team()
    assert not team.update_map('a', shared(ROOM))
    assert team.update_map('a', shared(HALF))
    assert team.update_map('a', shared(ROOM))


def test_the_first_name_is_the_target_on_every_robot() -> None:
    team = Team('b')
    team.update_map('a', shared(HALF))
    team.update_map('b', shared(ROOM))
    assert team.grids_of('a') == (team.maps['a'].grid, team.maps['b'].grid)


def test_accepted_transforms_are_told_from_the_own_map() -> None:
    team = full_team()
    team.record('a', verdict(THERE), *team.grids_of('a'), 0.0)       # T_a_b
    team.record('c', verdict(ELSEWHERE), *team.grids_of('c'), 0.0)   # T_b_c
    own = team.own_transforms()
    assert np.allclose(own['a'], inverse(THERE))
    assert own['c'] == ELSEWHERE
    assert team.peers() == ['a', 'c']


def test_a_reaches_c_through_b_and_all_agree_on_the_world() -> None:
    first, middle, last = (full_team(name) for name in 'abc')
    middle.record('a', verdict(THERE), *middle.grids_of('a'), 0.0)
    middle.record('c', verdict(ELSEWHERE), *middle.grids_of('c'), 0.0)
    for team in (first, last):
        team.hear('b', middle.own_constraints())
    truth = {'a': Pose(), 'b': THERE, 'c': compose(THERE, ELSEWHERE)}
    for team in (first, middle, last):
        (group,) = team.solution().groups
        for robot, pose in group.items():
            assert pose_error(pose, truth[robot])[0] < 1e-6
    assert first.own_transforms() == {}


def test_a_robot_is_reached_whose_map_never_came() -> None:
    team = Team('a')
    team.update_map('a', shared(ROOM))
    team.hear('b', [said('a', 'b', THERE), said('b', 'c', ELSEWHERE)])
    assert set(team.solution().group_of('a')) == {'a'}   # nobody told which maps they have
    team.begin('b', Epoch())
    team.begin('c', Epoch())
    assert set(team.solution().group_of('a')) == {'a', 'b', 'c'}


def test_what_a_peer_no_longer_says_is_forgotten() -> None:
    team = full_team('a')
    team.hear('b', [said('b', 'c', THERE)])
    assert len(team.solution().groups[0]) == 2
    team.hear('c', [])   # what others say is not touched
    assert len(team.solution().groups[0]) == 2
    team.hear('b', [])
    assert len(team.solution().groups) == 3


def test_nobody_speaks_for_others() -> None:
    team = full_team('a')
    team.hear('b', [said('a', 'c', THERE)])
    team.hear('a', [said('a', 'b', THERE)])
    team.sight(said('a', 'a', THERE, 'sighting'))
    team.sight(said('b', 'c', THERE, 'sighting'))
    assert len(team.solution().groups) == 3


def corner_room() -> Grid:
    """Draw a small room somewhere else."""
    return fake_grid(fake_room(3.0, 2.5), T_map_walls=Pose(20.0, 0.0, 1.0))


def test_a_map_that_lost_its_walls_and_its_area_was_begun_anew() -> None:
    assert begun_anew(ROOM, corner_room())
    assert not begun_anew(HALF, ROOM)
    assert not begun_anew(ROOM, HALF)


def test_what_is_said_of_a_map_dies_with_the_map() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.hear('c', [said('c', 'b', ELSEWHERE)])
    team.sight(said('a', 'b', THERE, 'sighting'))
    assert not team.begin('b', Epoch())
    assert len(team.solution().groups) == 1
    assert team.begin('b', Epoch('2e'))
    assert len(team.solution().groups) == 2   # its map went, too
    assert team.own_constraints() == []
    team.update_map('b', shared(ROOM))
    assert len(team.solution().groups) == 3
    assert team.is_due('b', 0.0)


def test_of_a_map_that_went_back_pairs_hold_until_they_are_matched_and_sightings_die() -> None:
    """After a crash, a SLAM goes on with an earlier state of its map than it had told."""
    team, back = full_team('a'), Epoch().gone_back('2e')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.hear('c', [said('c', 'b', ELSEWHERE)])
    team.sight(said('a', 'b', ELSEWHERE, 'sighting'))
    assert team.begin('b', back)
    assert [(c.kind, c.epochs) for c in team.own_constraints()] == [('match', (Epoch(), back))]
    assert team.solution().group_of('a').keys() == {'a', 'b'}     # what c says is of before
    assert 'b' in team.shown
    team.update_map('b', shared(ROOM))
    assert team.is_due('b', 0.0)
    assert team.record(
        'b', verdict(ELSEWHERE, 0.1), *team.grids_of('b'), 0.0) == 'withdrawn'
    assert team.own_constraints() == []


@pytest.mark.parametrize('robot', 'ab')
def test_who_goes_back_again_before_it_was_matched_loses_its_place(robot: str) -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    for start, held in (('2e', True), ('3d', False)):
        assert team.begin(robot, Epoch().gone_back(start))
        assert bool(team.own_constraints()) == held


def test_a_robot_that_was_matched_as_it_went_back_is_held_as_any_other() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.begin('b', Epoch().gone_back('2e'))
    team.update_map('b', shared(ROOM))
    assert team.record('b', verdict(THERE), *team.grids_of('b'), 0.0) == 'updated'
    assert team.record('b', verdict(ELSEWHERE, 0.1), *team.grids_of('b'), 0.0) == 'kept'


def test_a_word_on_a_map_counts_once_the_map_lives() -> None:
    """States and maps overtake one another on the network."""
    team, new = full_team('a'), Epoch('2e')
    early = replace(said('c', 'b', ELSEWHERE), epochs=(Epoch(), new))
    team.hear('c', [early])
    assert len(team.solution().groups) == 3
    team.begin('b', new)
    assert set(team.solution().group_of('b')) == {'b', 'c'}
    team.hear('c', [said('c', 'b', ELSEWHERE)])   # of the map that b had before
    assert len(team.solution().groups) == 2


def test_the_own_new_map_loses_every_place() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.record('c', verdict(THERE), *team.grids_of('c'), 0.0)
    team.hear('b', [said('a', 'b', THERE)])
    team.begin('a', Epoch('2e'))
    team.update_map('a', shared(corner_room()))
    assert len(team.solution().groups) == 3


def test_an_absent_robots_old_word_does_not_outvote_a_present_match() -> None:
    """The robot c left after it had matched b, and b began another map elsewhere."""
    team, new = full_team('a'), Epoch('2e')
    team.hear('c', [said('c', 'b', ELSEWHERE)] + 5 * [said('c', 'b', ELSEWHERE, 'sighting')])
    team.hear('c', list(team.heard_of('c')) + [said('a', 'c', THERE)])
    team.begin('b', new)
    team.update_map('b', shared(ROOM))
    team.record('b', verdict(NEARLY_THERE), *team.grids_of('b'), 0.0)
    solution = team.solution()
    assert np.allclose(solution.group_of('a')['b'], NEARLY_THERE)
    assert not solution.dropped


@pytest.mark.parametrize('restarted', 'ab')
def test_five_true_sightings_and_then_a_restart_do_not_outvote_a_present_match(restarted: str
                                                                               ) -> None:
    """Each robot had seen the other one five times; then one began another map."""
    team = full_team('a')
    for _ in range(5):
        team.sight(said('a', 'b', ELSEWHERE, 'sighting'))
    team.hear('b', 5 * [said('b', 'a', Pose.from_array(inverse(ELSEWHERE)), 'sighting')])
    assert np.allclose(team.solution().group_of('a')['b'], ELSEWHERE)
    team.begin(restarted, Epoch('2e'))
    team.update_map(restarted, shared(ROOM))
    assert {*team.solution().group_of('a')} == {'a'}
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    solution = team.solution()
    assert np.allclose(solution.group_of('a')['b'], THERE)
    assert not solution.dropped


def test_sightings_join_maps() -> None:
    team = full_team('a')
    team.sight(said('a', 'c', THERE, 'sighting'))
    assert team.solution().group_of('a')['c'] == pytest.approx(THERE)
    assert team.own_transforms() == {'c': THERE}


def test_known_poses_need_no_match() -> None:
    team = Team('b', known_poses={'a': Pose(1, 0, 0), 'b': Pose(1, 2, np.pi / 2), 'z': Pose()})
    for robot in 'ab':
        team.update_map(robot, shared(ROOM))
    assert team.peers() == []
    (group,) = team.solution().groups
    assert np.allclose(group['b'], (0, 2, np.pi / 2))


def test_reset_forgets_verdicts_and_keeps_maps() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.hear('b', [said('b', 'c', THERE)])
    team.reset()
    assert len(team.solution().groups) == 3
    assert team.peers() == ['b', 'c']


def test_verdicts_of_both_robots_of_a_pair_count_once() -> None:
    one, both = full_team('a'), full_team('a')
    for team in (one, both):
        team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    both.hear('b', [said('a', 'b', THERE)])
    assert np.allclose(one.solution().covariances['b'], both.solution().covariances['b'],
                       rtol=0.3)


def test_sightings_beside_a_match_are_weighed_with_it() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    alone = np.trace(team.solution().covariances['b'])
    for _ in range(20):
        team.sight(said('a', 'b', NEARLY_THERE, 'sighting'))
    solution = team.solution()
    assert np.trace(solution.covariances['b']) < alone
    assert pose_error(solution.group_of('a')['b'], THERE)[0] < 0.05
    assert team.own_transforms()['b'] == THERE   # a match is told before a sighting
    assert len(team.own_constraints()) < 8             # sightings are not piled up


def test_a_wrong_sighting_is_dropped_by_name() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    team.sight(said('a', 'b', ELSEWHERE, 'sighting'))
    (dropped,) = team.solution().dropped
    assert 'a - b (sighting) contradicts' in dropped.reason
    assert pose_error(team.solution().group_of('a')['b'], THERE)[0] < 0.01


def test_a_map_of_another_building_is_not_shown_in_a_peers_place() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.grids_of('b'), 0.0)
    before = team.shown['b']
    other = fake_grid(fake_room(12.0, 9.0), T_map_walls=Pose(5.0, 9.0, 0.4))
    assert team.update_map('b', shared(other))
    assert team.shown['b'] is before
    team.record('b', verdict(ELSEWHERE, 0.1), *team.grids_of('b'), 1.0)   # refused, once
    assert team.shown['b'] is before
    team.update_map('b', shared(ROOM))
    assert team.shown['b'] is team.maps['b']


def test_a_robot_that_begins_anew_again_and_again_is_counted() -> None:
    team = full_team('a')
    for number in range(3):
        team.begin('b', Epoch('2e', number))
    assert team.begun['b'] == 3


def test_known_poses_lapse_with_the_map_that_they_were_given_for() -> None:
    team = Team('a', known_poses={'a': Pose(), 'b': THERE})
    for robot in 'ab':
        team.update_map(robot, shared(ROOM))
    assert team.solution().group_of('a')['b'] == THERE
    team.begin('b', Epoch().gone_back('1f'))       # the same map
    team.update_map('b', shared(ROOM))
    assert team.solution().group_of('a')['b'] == THERE
    team.begin('b', Epoch('2e'))
    team.update_map('b', shared(ROOM))
    assert team.known.lapsed(team.epochs) == ['b']
    assert len(team.solution().groups) == 2
    assert team.peers() == ['b']   # from now on it is matched
    team.reset()
    assert team.known.lapsed(team.epochs) == []     # the user says that it holds now
    assert team.solution().group_of('a')['b'] == THERE


@pytest.mark.parametrize('count', [2, 3, 5, 8])
def test_all_robots_of_a_team_draw_the_same_map(count: int) -> None:
    """Each matches its neighbours only, with its own error; all else comes from the others."""
    rng, names = np.random.default_rng(count), 'abcdefgh'[:count]
    frames = {name: Pose(*rng.uniform(-3, 3, 3)) for name in names}
    maps = {name: SharedMap(cut_grid(fake_grid(fake_room(), T_map_walls=frame), (-9, -9), (9, 9)))
            for name, frame in frames.items()}
    teams = {name: Team(name) for name in names}
    for team in teams.values():
        for name, one in maps.items():
            team.update_map(name, one)
    for first, second in zip(names, names[1:]):
        truth = compose(frames[first], inverse(frames[second]))
        for own, peer in ((first, second), (second, first)):
            found = verdict(Pose.from_array(truth + rng.normal(0, (0.02, 0.02, 0.003))))
            teams[own].record(peer, found, *teams[own].grids_of(peer), 0.0)
    for owner, team in teams.items():
        for other in teams.values():
            other.hear(owner, team.own_constraints())
    drawn = []
    for name, team in teams.items():
        world = team.solution().group_of(name)
        assert set(world) == set(names)
        for robot, pose in world.items():
            truth = compose(frames['a'], inverse(frames[robot]))
            assert pose_error(pose, truth)[0] < 0.02 * count
        drawn.append(merge_grids({robot: one.grid for robot, one in team.maps.items()}, {
            robot: Pose(*np.round(pose, 4)) for robot, pose in world.items()}))
    for merged in drawn[1:]:
        assert merged.T_frame_grid == drawn[0].T_frame_grid
        assert np.mean(merged.evidence == drawn[0].evidence) > 0.9999
