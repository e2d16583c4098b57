# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of robots that are gone, and how those who are left agree on it."""

from helpers import cut_grid, fake_grid, fake_room
import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.team.departed import Keeping, Kept
from somfusion_ros.team.graph import Edge
from somfusion_ros.team.members import Team
from somfusion_ros.team.shared_map import mark_driven, SharedMap

ROOM = fake_grid(fake_room())
LESS = cut_grid(ROOM, (-1.0, -1.0), (5.0, 7.0))
THERE, NEARBY = Pose(3.0, 1.0, 0.5), Pose(3.1, 1.0, 0.5)


def edge(pose: Pose) -> Edge:
    """Make what the robot d, which is gone, had accepted about b."""
    return Edge('b', 'd', pose, np.diag([0.01, 0.01, 1e-4]))


def memory(name: str, grid: object = None, pose: Pose = THERE) -> tuple[Team, Keeping]:
    """Make a robot that knew d, or did not."""
    team = Team(name)
    if grid is not None:
        team.update_map('d', SharedMap(grid))
        team.hear('d', [edge(pose)])
    return team, Keeping(team)


def test_who_is_there_is_not_kept() -> None:
    _, keeping = memory('b', ROOM)
    keeping.update({'b', 'd'})
    assert keeping.kept == ()
    keeping.update({'b'})
    assert [kept.robot for kept in keeping.kept] == ['d']
    assert set(keeping.maps()) == {'d'}


def test_a_late_joiner_asks_for_the_map_and_takes_the_edges() -> None:
    _, old = memory('b', ROOM)
    old.update({'b', 'c'})
    team, new = memory('c')
    new.hear('b', old.kept)
    new.update({'b'})
    assert new.sources == {'d': 'b'}
    assert set(team.solution().group_of('d')) == {'b', 'd'}
    team.update_map('d', SharedMap(ROOM))
    new.update({'b'})
    assert new.sources == {}
    assert [kept.robot for kept in new.kept] == ['d']


def test_all_agree_on_the_memory_that_knows_most_and_then_on_the_first_name() -> None:
    robots = {'a': memory('a', LESS, NEARBY), 'b': memory('b', ROOM),
              'c': memory('c', ROOM, NEARBY)}
    for _ in range(2):
        for _, keeping in robots.values():
            keeping.update(set('abc'))
        for name, (_, keeping) in robots.items():
            for other, (_, listening) in robots.items():
                if other != name:
                    listening.hear(name, keeping.kept)
    for _, keeping in robots.values():
        keeping.update(set('abc'))
    assert robots['a'][1].sources == {'d': 'b'}
    assert robots['b'][1].sources == robots['c'][1].sources == {}
    for team, _ in robots.values():
        assert team.heard_of('d')[0].T_target_source == THERE


def test_nothing_is_believed_about_oneself_or_from_who_is_gone() -> None:
    team, keeping = memory('c')
    keeping.hear('b', (Kept('c', 10 ** 6, (Edge('b', 'c', THERE, np.eye(3)),)),))
    keeping.hear('e', (Kept('d', 10 ** 6, (edge(THERE),)),))
    keeping.update({'b'})
    assert keeping.sources == {}
    assert team.solution().groups == ({'c': Pose()},)


def test_a_kept_map_is_handed_on_bit_by_bit() -> None:
    cells = mark_driven(SharedMap(ROOM).to_cells(), [(1.0, 1.0), (2.0, 1.5)])
    again = SharedMap.from_cells(cells).to_cells()
    assert np.array_equal(again.values, cells.values)
    assert again[1:] == cells[1:]
