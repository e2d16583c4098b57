# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who is joined by whose word, where the other robot of that pair does not say it."""

from collections.abc import Sequence

import numpy as np
import pytest
from somfusion_ros.geometry import between, Pose
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.graph import solve
from somfusion_ros.team.hanging import Hanging, hanging, TUNING
from somfusion_ros.team.solution import Solution

GOOD = np.diag([0.01, 0.01, 1e-4])
PLACES = {name: Pose(float(k), 0.0, 0.0) for k, name in enumerate('abcdez')}


def said(pairs: str) -> Solution:
    """Solve what robots say: `ab` is that a says where b is, `ba` that b says where a is."""
    return solve(PLACES, [MapConstraint(
        one, other, Pose.from_array(between(PLACES[one], PLACES[other])), GOOD, author=one)
        for one, other in pairs.split()])


@pytest.mark.parametrize(('pairs', 'name', 'mute', 'expected'), [
    ('ab ba bc cb', 'a', '', {}),                       # both say each
    ('ab', 'a', '', {}), ('ab', 'b', '', {'a': 'a'}),   # the own verdict is sure
    ('ab ba cd dc za zc', 'a', '', {'c': 'z', 'd': 'z', 'z': 'z'}),     # z joins two groups
    ('ab ba cd dc za zc', 'c', '', {'a': 'z', 'b': 'z', 'z': 'z'}),
    ('ab ba cd dc za zc bc cb', 'a', '', {'z': 'z'}),   # which others join as well
    ('ab ba cd dc za zd az', 'a', '', {'c': 'z', 'd': 'z'}),     # a itself accepts z
    ('ab ba zb zc ec', 'a', '', {'c': 'z', 'z': 'z', 'e': 'ez'}),
    ('ab ba bd', 'a', '', {'d': 'b'}), ('ab ba bd', 'a', 'd', {}),      # d cannot say it
    ('ab ba zd', 'a', 'd', {})])
def test_who_hangs_on_whose_word(pairs: str, name: str, mute: str, expected: dict[str, str]
                                 ) -> None:
    found = hanging(said(pairs), name, mute)
    assert found == {robot: tuple(authors) for robot, authors in expected.items()}


def run(hangs: Hanging, solutions: Sequence[Solution], clock: list[float], step: float
        ) -> list[tuple[str, str]]:
    """Tell of solutions, a step [s] apart."""
    new = []
    for solution in solutions:
        new += hangs.update(solution, '')
        clock[0] += step
    return new


def test_it_is_said_once_after_a_while_and_as_long_as_it_lasts() -> None:
    clock = [0.0]
    hangs = Hanging('a', lambda: clock[0])
    joined, moment = said('ab ba cd dc za zc'), said('ab ba bc')
    assert not run(hangs, 20 * [moment, said('ab ba bc cb')], clock, 20.0)
    new = run(hangs, 10 * [joined], clock, 5.0)
    assert [author for author, _ in new] == ['z', 'z', 'z']
    assert new[0][1] == ('c is joined to a only by what z says alone: the other robot of that '
                         'pair does not')
    assert {*hangs.doubtful} == {*'cdz'}
    assert not run(hangs, 10 * [joined], clock, 5.0)
    assert not run(hangs, [said('ab ba cd dc za zc bc cb')], clock, TUNING.patience)
    assert {*hangs.doubtful} == {*'z'}
