# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""For which map the user gave a pose, where robots are started anew: all come to one answer."""

from itertools import permutations

import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.known_poses import KnownPoses

POSES = {name: Pose(float(k), 0.0, 0.0) for k, name in enumerate('abx')}
FIRST, SECOND = Epoch('1f'), Epoch('2e')


class Robot:
    """One robot: what it knows of poses, and which maps it has heard of."""

    def __init__(self, name: str) -> None:
        self.name, self.known = name, KnownPoses(POSES)
        self.epochs: dict[str, Epoch] = {}

    def see(self, robot: str, epoch: Epoch, given: Epoch | None = None) -> None:
        """Hear which map a robot has, and for which one it was given its pose."""
        self.known.bind(robot, given or epoch)
        self.epochs[robot] = epoch

    @property
    def holding(self) -> set[str]:
        """Robots whose pose holds."""
        return {*self.known.holding(self.epochs)}


def talk(*robots: Robot) -> None:
    """Let all tell all others twice."""
    for _ in range(2):
        for one in robots:
            for other in robots:
                if one is not other:
                    other.known.hear(one.name, one.known.denied(one.epochs))


def started(*names: str, epochs: dict[str, Epoch]) -> list[Robot]:
    """Start robots that see these maps."""
    robots = [Robot(name) for name in names]
    for robot in robots:
        for name, epoch in epochs.items():
            robot.see(name, epoch)
    return robots


EPOCHS = {'a': Epoch('a'), 'b': Epoch('b'), 'x': FIRST}


@pytest.mark.parametrize('order', [*permutations(range(3))])
def test_all_deny_the_pose_of_a_robot_that_was_started_anew_without_its_map(
        order: tuple[int, ...]) -> None:
    """The robot x itself and b, which is started later, knew nothing of the map before."""
    (a,) = started('a', epochs=EPOCHS)
    a.see('x', SECOND, SECOND)
    b, x = started('b', 'x', epochs={**EPOCHS, 'x': SECOND})
    talk(*(one for _, one in sorted(zip(order, (a, b, x)), key=lambda item: item[0])))
    for robot in (a, b, x):
        assert robot.holding == {'a', 'b'}
        assert robot.known.lapsed(robot.epochs) == ['x']
        assert robot.known.lapsed(robot.epochs) == []       # each is said once
    (late,) = started('b', epochs={**EPOCHS, 'x': SECOND})
    talk(x, late)                                           # a has gone
    assert late.holding == {'a', 'b'}


def test_the_user_says_on_every_robot_that_it_stands_there_again() -> None:
    (a,) = started('a', epochs=EPOCHS)
    a.see('x', SECOND)
    b, x = started('b', 'x', epochs={**EPOCHS, 'x': SECOND})
    talk(a, b, x)
    for robot in (b, a, x):
        robot.known.rebind(robot.epochs)
        talk(a, b, x)
    assert all(robot.holding == {*'abx'} for robot in (a, b, x))
    for robot in (a, b, x):
        robot.see('x', FIRST._replace(reset=1))             # that word is of that map only
    assert all(robot.holding == {*'ab'} for robot in (a, b, x))


def test_a_team_that_is_started_anew_as_a_whole_has_its_poses() -> None:
    robots = started(*'abx', epochs={name: Epoch(f'{name}2') for name in 'abx'})
    talk(*robots)
    assert all(robot.holding == {*'abx'} for robot in robots)


def test_a_robot_that_goes_on_with_its_map_keeps_its_pose() -> None:
    robots = started(*'abx', epochs=EPOCHS)
    robots[0].see('x', FIRST.gone_back('5d'))
    talk(*robots)
    assert all(robot.holding == {*'abx'} for robot in robots)


def test_who_has_no_pose_has_no_say() -> None:
    """A liar of any name denies in vain, and so does one who speaks of a map that nobody has."""
    (a,) = started('a', epochs=EPOCHS)
    a.known.hear('z', {'b': Epoch('b'), 'x': FIRST})
    a.known.hear('b', {'x': SECOND, **{f'g{k}': SECOND for k in range(64)}})
    assert a.holding == {*'abx'}
    assert len(a.known._said) == 1
    assert {*a.known._said['b']} == {'x'}
