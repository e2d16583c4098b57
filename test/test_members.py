# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A live team: pairs only when due, hysteresis, reaching others through peers, restarts."""

from helpers import cut_grid, fake_grid, fake_room, pose_error
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import Alignment, RunnerUp
from somfusion_ros.fusion.members import begun_anew, Team
from somfusion_ros.fusion.pair import change, Pair, REFUSALS, same_pose, SOON, TIME_SHARE
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid

ROOM = fake_grid(fake_room())
HALF = cut_grid(ROOM, (-1.0, -1.0), (4.0, 7.0))
THERE, ELSEWHERE = Pose(3.0, 1.0, 0.5), Pose(-4.0, 2.0, -2.0)
NEARLY_THERE = Pose(3.05, 1.02, 0.51)


def copy_of(grid: Grid) -> Grid:
    """Make another object with the same content, as every message does."""
    return Grid(grid.evidence.copy(), grid.resolution, grid.T_frame_grid)


def verdict(pose: Pose | None, probability: float = 0.97, rival: float = 0.1) -> Alignment:
    """Make an alignment that is accepted at 0.95, with a rival somewhere else."""
    return Alignment(probability >= 0.95, probability, f'probability {probability}', pose,
                     runner_up=RunnerUp(Pose(), rival))


def told(pair: Pair, *verdicts: Alignment) -> list[str]:
    """Give a pair verdicts and return what it made of them."""
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
    pair = Pair()
    assert pair.due(HALF, ROOM, 0.0, 0.1)
    pair.record(verdict(None, 0.0), HALF, ROOM, 0.0)
    assert not pair.due(HALF, ROOM, 1e6, 0.1)
    assert not pair.due(copy_of(HALF), copy_of(ROOM), 1e6, 0.1)
    assert pair.due(ROOM, ROOM, 1.0, 0.1)


def test_small_changes_count_after_a_while() -> None:
    pair, slightly = Pair(), cut_grid(ROOM, (-1.0, -1.0), (7.7, 7.0))
    assert 0.01 < change(slightly, ROOM) < 0.3
    pair.record(verdict(None, 0.0), ROOM, slightly, 100.0)
    assert not pair.due(ROOM, ROOM, 101.0, 0.5)
    assert pair.due(ROOM, ROOM, 101.0 + SOON, 0.5)
    slow = Alignment(False, 0.0, 'refused', seconds={'all': 2.0 * SOON})
    pair.record(slow, ROOM, slightly, 200.0)
    assert not pair.due(ROOM, ROOM, 201.0 + SOON, 0.5)
    assert pair.due(ROOM, ROOM, 201.0 + 2.0 * SOON * TIME_SHARE, 0.5)


def test_same_pose_is_judged_at_the_walls() -> None:
    assert same_pose(THERE, NEARLY_THERE, ROOM)
    assert not same_pose(THERE, ELSEWHERE, ROOM)
    assert not same_pose(THERE, Pose(3.0, 1.0, 0.7), ROOM)
    far = Grid(ROOM.evidence, ROOM.resolution, Pose(50.0, 0.0, 0.0))
    assert not same_pose(THERE, Pose(3.0, 1.0, 0.52), far)   # 0.02 rad at 50 m is 1 m


def test_refused_is_not_held() -> None:
    pair = Pair()
    assert told(pair, verdict(THERE, 0.5), verdict(None, 0.0)) == ['refused', 'refused']
    assert pair.held is None


def test_the_same_pose_follows_smoothly() -> None:
    pair = Pair()
    assert told(pair, verdict(THERE), verdict(NEARLY_THERE, 0.96)) == ['accepted', 'updated']
    assert pair.held.T_target_source == NEARLY_THERE


def test_another_pose_must_be_clearly_better_twice_in_a_row() -> None:
    pair = Pair()
    better, worse = verdict(ELSEWHERE, 0.97), verdict(ELSEWHERE, 0.96, rival=0.95)
    assert told(pair, verdict(THERE), worse, worse, worse) == ['accepted'] + 3 * ['kept']
    assert told(pair, better, verdict(THERE), better) == ['kept', 'updated', 'kept']
    assert pair.held.T_target_source == THERE
    assert told(pair, better) == ['replaced']
    assert pair.held.T_target_source == ELSEWHERE


def test_a_rival_is_looked_at_again_though_no_map_changes() -> None:
    pair = Pair()
    told(pair, verdict(THERE), verdict(ELSEWHERE))
    assert not pair.settled
    assert not pair.due(ROOM, ROOM, 0.9 * SOON, 0.1)
    assert pair.due(ROOM, ROOM, SOON, 0.1)
    assert told(pair, verdict(ELSEWHERE)) == ['replaced']
    assert not pair.due(ROOM, ROOM, 1e6, 0.1)


def test_two_different_rivals_do_not_confirm_one_another() -> None:
    pair = Pair()
    told(pair, verdict(THERE), verdict(ELSEWHERE, 0.999), verdict(Pose(9, 9, 1), 0.999))
    assert pair.held.T_target_source == THERE


def test_clear_refusals_in_a_row_withdraw_a_verdict() -> None:
    pair = Pair()
    doubts = [verdict(ELSEWHERE, 0.1)] * (REFUSALS - 1)
    told(pair, verdict(THERE), *doubts)
    assert pair.held is not None
    told(pair, verdict(THERE), *doubts)   # an acceptance in between begins the count anew
    assert pair.held is not None
    assert told(pair, verdict(THERE, 0.1)) == ['withdrawn']
    assert pair.held is None


def test_nearly_accepted_at_the_same_pose_is_no_doubt() -> None:
    pair = Pair()
    assert set(told(pair, verdict(THERE), *[verdict(NEARLY_THERE, 0.9)] * 10)[1:]) == {'kept'}


def full_team(name: str = 'b') -> Team:
    """Make a team of a, b and c in which every map is known."""
    team = Team(name)
    for robot in 'abc':
        team.update_map(robot, copy_of(ROOM))
    return team


def test_nothing_can_be_matched_before_the_own_map_came() -> None:
    team = Team('b')
    team.update_map('a', ROOM)
    assert team.peers() == []
    assert team.solution().groups == ({'a': Pose()}, {'b': Pose()})


def test_maps_are_compared_for_change() -> None:
    team = full_team()
    assert not team.update_map('a', copy_of(ROOM))
    assert team.update_map('a', HALF)
    assert team.update_map('a', ROOM)


def test_the_first_name_is_the_target_on_every_robot() -> None:
    team = Team('b')
    team.update_map('a', HALF)
    team.update_map('b', ROOM)
    assert team.maps('a') == (HALF, ROOM)


def test_accepted_transforms_are_told_from_the_own_map() -> None:
    team = full_team()
    team.record('a', verdict(THERE), *team.maps('a'), 0.0)       # T_a_b
    team.record('c', verdict(ELSEWHERE), *team.maps('c'), 0.0)   # T_b_c
    own = team.own_transforms()
    assert np.allclose(own['a'], inverse(THERE))
    assert own['c'] == ELSEWHERE
    assert team.peers() == ['a', 'c']


def test_a_reaches_c_through_b_and_all_agree_on_the_world() -> None:
    first, middle, last = (full_team(name) for name in 'abc')
    middle.record('a', verdict(THERE), *middle.maps('a'), 0.0)
    middle.record('c', verdict(ELSEWHERE), *middle.maps('c'), 0.0)
    for team in (first, last):
        for peer, pose in middle.own_transforms().items():
            team.receive('b', peer, pose, 0.0)
    truth = {'a': Pose(), 'b': THERE, 'c': compose(THERE, ELSEWHERE)}
    for team in (first, middle, last):
        (group,) = team.solution().groups
        for robot, pose in group.items():
            assert pose_error(pose, truth[robot])[0] < 1e-6
    assert first.own_transforms() == {}


def test_a_robot_is_reached_whose_map_never_came() -> None:
    team = Team('a')
    team.update_map('a', ROOM)
    team.receive('b', 'a', Pose.from_array(inverse(THERE)), 0.0)
    team.receive('b', 'c', ELSEWHERE, 0.0)
    assert set(team.solution().group_of('a')) == {'a', 'b', 'c'}


def test_what_a_living_peer_no_longer_repeats_is_forgotten() -> None:
    team = full_team('a')
    team.receive('b', 'c', THERE, 0.0)
    team.expire(set(), 1e6, 30.0)   # b is gone: what it said remains
    assert len(team.solution().groups[0]) == 2
    team.expire({'b'}, 29.0, 30.0)
    assert len(team.solution().groups[0]) == 2
    team.expire({'b'}, 31.0, 30.0)
    assert len(team.solution().groups) == 3


def test_nonsense_from_peers_changes_nothing() -> None:
    team = full_team('a')
    team.receive('b', 'b', THERE, 0.0)
    team.receive('a', 'b', THERE, 0.0)
    team.sight('a', THERE)
    assert len(team.solution().groups) == 3


def test_a_robot_that_begins_a_new_map_loses_its_old_place() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.maps('b'), 0.0)
    team.receive('c', 'b', ELSEWHERE, 0.0)
    corner = fake_grid(fake_room(3.0, 2.5), T_map_walls=Pose(20.0, 0.0, 1.0))
    assert begun_anew(ROOM, corner)
    assert not begun_anew(HALF, ROOM)
    assert not begun_anew(ROOM, HALF)
    team.update_map('b', corner)
    assert len(team.solution().groups) == 3
    assert team.is_due('b', 0.0)


def test_the_own_new_map_loses_every_place() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.maps('b'), 0.0)
    team.record('c', verdict(THERE), *team.maps('c'), 0.0)
    team.update_map('a', fake_grid(fake_room(3.0, 2.5), T_map_walls=Pose(20.0, 0.0, 1.0)))
    assert len(team.solution().groups) == 3


def test_sightings_join_maps() -> None:
    team = full_team('a')
    team.sight('c', THERE)
    assert team.solution().group_of('a')['c'] == pytest.approx(THERE)
    assert team.own_transforms() == {'c': THERE}


def test_known_poses_need_no_match() -> None:
    team = Team('b', known_poses={'a': Pose(1, 0, 0), 'b': Pose(1, 2, np.pi / 2), 'z': Pose()})
    for robot in 'ab':
        team.update_map(robot, ROOM)
    assert team.peers() == []
    (group,) = team.solution().groups
    assert np.allclose(group['b'], (0, 2, np.pi / 2))


def test_reset_forgets_verdicts_and_keeps_maps() -> None:
    team = full_team('a')
    team.record('b', verdict(THERE), *team.maps('b'), 0.0)
    team.receive('b', 'c', THERE, 0.0)
    team.reset()
    assert len(team.solution().groups) == 3
    assert team.peers() == ['b', 'c']
