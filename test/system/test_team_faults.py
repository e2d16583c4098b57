# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A team of real processes that meets what teams meet: members come, go, die and lie.

One team lives through all tests of this file. After every fault no process is dead and, within
30 s, all robots that are left show the same global map: 99.9 % of its known cells are equal, and
98 % of what each robot published last is known at its true place.
"""

from collections.abc import Iterator
import signal

from helpers import fake_grid, fake_room, need_ros
import pytest
from somfusion_ros.team.shared_map import MapCells

need_ros()

from team_lab import frame_of, Lab, map_of, START  # noqa: E402, I100

pytestmark = pytest.mark.system
TEAM = ['robot1', 'robot2', 'robot3']
SIZE = 4    # of the team whose parts of the building the robots show


@pytest.fixture(scope='module')
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Return a team of three that has found together."""
    with Lab(tmp_path_factory.mktemp('team')) as made:
        for number, robot in enumerate(TEAM, start=1):
            made.add(robot, map_of(number, SIZE, 0.8))
        made.until_equal(TEAM, timeout=START)
        yield made
        made.assert_clean()


def test_a_late_joiner_gets_everything_and_its_map_stays_when_it_leaves(lab: Lab) -> None:
    lab.add('robot4', map_of(4, SIZE))
    lab.until_equal([*TEAM, 'robot4'])
    assert lab.remove('robot4') == 0
    lab.publish('robot1', map_of(1, SIZE))
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


def test_who_joins_after_another_left_gets_the_map_of_that_one_too(lab: Lab) -> None:
    lab.end('robot3', signal.SIGKILL)
    lab.start('robot3')
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


@pytest.mark.parametrize('use_sim_time', [False, True])
def test_a_killed_fusion_node_comes_back(lab: Lab, use_sim_time: bool) -> None:
    assert lab.end('robot2', signal.SIGKILL) == -signal.SIGKILL
    lab.publish('robot3', map_of(3, SIZE, 0.9 + 0.1 * use_sim_time))
    lab.until_equal(['robot1', 'robot3'], [*TEAM, 'robot4'])
    lab.start('robot2', use_sim_time=use_sim_time)
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


def test_time_may_jump_back(lab: Lab) -> None:
    lab.publish('robot2', map_of(2, SIZE, 0.85), stamp=1000.0)
    lab.until_equal(TEAM, [*TEAM, 'robot4'])
    lab.publish('robot2', map_of(2, SIZE), stamp=3.0)
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


def test_two_robots_of_one_name_are_noticed_and_hurt_nobody_else(lab: Lab) -> None:
    lab.start('second robot3', namespace='robot3')
    lab.until(lambda: int(lab.status('robot1').get('state_of_robot3_unusable', 0)) > 0,
              lambda: 'robot1 notices two robots called robot3')
    lab.until(lambda: int(lab.status('robot3').get('name_taken', 0)) > 0,
              lambda: 'robot3 notices it too')
    assert {'robot1', 'robot2'} <= lab.connected('robot1')
    assert lab.end('second robot3') == 0
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


def test_a_flood_of_garbage_hurts_nobody(lab: Lab) -> None:
    before = lab.memory('robot1')
    lab.run('hostile', 'hostile_robot.py', 'robot0')   # its name sorts first
    lab.until(lambda: sum(int(value) for kind, value in lab.status('robot1').items()
                          if kind.endswith('of_robot0_unusable')) > 20,
              lambda: 'robot1 refuses what robot0 says')
    lab.publish('robot2', map_of(2, SIZE, 0.9))
    lab.until_equal(TEAM, [*TEAM, 'robot4'])
    lab.pause(5.0)
    assert lab.memory('robot1') - before < 50.0   # [MB]
    assert lab.end('hostile', signal.SIGKILL) == -signal.SIGKILL
    lab.until_equal(TEAM, [*TEAM, 'robot4'])


def test_a_map_that_flips_between_two_buildings_loses_that_robot_at_most(lab: Lab) -> None:
    elsewhere = fake_grid(fake_room(5.0, 4.0), T_map_walls=frame_of(9))
    flipped = MapCells(elsewhere.to_occupancy(), elsewhere.resolution, elsewhere.T_frame_grid)
    for _ in range(3):
        for cells in (flipped, map_of(3, SIZE)):
            lab.publish('robot3', cells)
            lab.pause(1.5)
            assert {'robot1', 'robot2', 'robot4'} <= lab.connected('robot1')
            assert {'robot1', 'robot2', 'robot4'} <= lab.connected('robot2')
    lab.until(lambda: lab.equal_within(['robot1', 'robot2']), lambda: 'robot1 and robot2 equal')


def test_a_robot_under_a_new_name_is_welcome(lab: Lab) -> None:
    assert lab.remove('robot3') == 0
    lab.add('robot13', map_of(3, SIZE))
    lab.until_equal(['robot1', 'robot2', 'robot13'], ['robot1', 'robot2', 'robot4', 'robot13'],
                    others={'robot3'})
