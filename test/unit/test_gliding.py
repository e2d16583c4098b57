# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is shown of the joint solution moves in steps, and ends where it was solved, to the bit."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, wrap
from somfusion_ros.team.gliding import Glide, TUNING

SLACK = 1e-9
NAMES = 'a', 'b'


def solution(seed: int, bend: float, views: int) -> dict[str, Array]:
    """Two robots on straight paths, bent by up to a distance [m]."""
    rng = np.random.default_rng(seed)
    found = {}
    for name in NAMES:
        poses = np.column_stack([np.arange(views) * 0.4, np.zeros(views), np.zeros(views)])
        wave = np.sin(np.linspace(0.0, rng.uniform(1.0, 6.0), views))
        found[name] = np.round(poses + bend * wave[:, None] * rng.uniform(-1.0, 1.0, 3)
                               * (1.0, 1.0, 0.1), 4)
    return found


def moved(before: dict[str, Array], after: dict[str, Array]) -> tuple[float, float]:
    """Return how far [m] [rad] views that were shown before moved at most."""
    d = np.concatenate([after[name][:len(before[name])] - before[name] for name in before])
    return float(np.hypot(d[:, 0], d[:, 1]).max()), float(np.abs(wrap(d[:, 2])).max())


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.floats(0.0, 0.7), st.integers(3, 40), st.integers(0, 8)),
                min_size=2, max_size=6), st.integers(0, 99))
def test_nothing_shown_moves_by_more_than_a_step(
        solutions: list[tuple[float, int, int]], seed: int) -> None:
    """Solutions come while the last one is still on the way; views are added meanwhile."""
    said: list[str] = []
    glide, now, views = Glide(said.append), 0.0, 2
    for k, (bend, more, steps) in enumerate(solutions):
        views += more
        goal = solution(seed + k, bend, views)
        before = glide.shown
        glide.aim(goal, 'group')
        for _ in range(steps + 1):
            if before and not said:
                distance, heading = moved(before, glide.shown)
                assert distance <= TUNING.distance + SLACK
                assert heading <= TUNING.heading + SLACK
            said.clear()
            before = glide.shown
            now += TUNING.period
            glide.step(now)
    for _ in range(20):
        now += TUNING.period
        glide.step(now)
    assert glide.arrived
    for name in NAMES:
        assert np.array_equal(glide.shown[name], goal[name])


def test_steps_take_their_time() -> None:
    glide, start, goal = Glide(), solution(1, 0.0, 30), solution(1, 0.6, 30)
    glide.aim(start, 'group')
    glide.aim(goal, 'group')
    glide.step(10.0)
    first = glide.shown
    glide.step(10.0 + 0.9 * TUNING.period)
    assert glide.shown is first
    glide.step(10.0 + TUNING.period)
    assert moved(first, glide.shown)[0] > 0.1


def test_another_group_and_a_far_solution_are_shown_at_once() -> None:
    said: list[str] = []
    glide, near = Glide(said.append), solution(1, 0.0, 30)
    far = {name: poses + (3.0, 0.0, 0.0) for name, poses in near.items()}
    glide.aim(near, 'one')
    glide.aim(far, 'two')
    assert glide.arrived
    assert not said      # whoever makes another group says so
    glide.aim(near, 'two')
    assert glide.arrived
    assert said == ['the joint solution moved by up to 3.0 m and 0 deg: it is shown at once']


def test_nothing_is_left_to_show_where_all_maps_are_other_ones() -> None:
    glide = Glide()
    glide.aim(solution(1, 0.0, 9), 'group')
    glide.aim(solution(1, 0.5, 9), 'group')
    assert not glide.arrived
    glide.keep(())
    glide.step(1e3)
    assert glide.arrived and not glide.shown


def test_a_new_view_lies_on_from_what_is_shown() -> None:
    glide, whole = Glide(), solution(4, 0.6, 30)
    glide.aim(solution(4, 0.0, 20), 'group')
    glide.aim(whole, 'group')
    for name in NAMES:
        assert between(glide.shown[name][19], glide.shown[name][25]) == pytest.approx(
            between(whole[name][19], whole[name][25]), abs=1e-9)
