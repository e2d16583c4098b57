# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The team's graph: every robot placed alike, contradictions dropped and said."""

from dataclasses import replace
from itertools import combinations
from typing import Any

from helpers import pose_error
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, inverse, Pose
from somfusion_ros.team import estimate
from somfusion_ros.team.constraint import Dropped, MapConstraint, sane_covariance, with_drift
from somfusion_ros.team.graph import solve

EXACT = np.eye(3) * 1e-6


def team(count: int, rng: np.random.Generator) -> dict[str, Pose]:
    """Return true map frames of robots a, b, c ... in a common frame."""
    return {name: Pose(*rng.uniform(-10, 10, 2), rng.uniform(-np.pi, np.pi))
            for name in 'abcdefgh'[:count]}


def constraint(truth: dict[str, Pose], target: str, source: str, error: Array = np.zeros(3),
               probability: float = 1.0) -> MapConstraint:
    """Make a constraint off the truth by an error (x, y, theta) in the target frame."""
    return MapConstraint(target, source, Pose.from_array(
        np.add(between(truth[target], truth[source]), error)), EXACT, probability)


def assert_placed(group: dict[str, Pose], truth: dict[str, Pose], metres: float = 1e-6) -> None:
    """Check that a group's world is the map frame of its first name, and all poses are true."""
    anchor = min(group)
    assert group[anchor] == Pose()
    for name, pose in group.items():
        assert pose_error(pose, between(truth[anchor], truth[name]))[0] < metres


def test_nobody_and_one_alone() -> None:
    assert solve([], []).groups == ()
    assert solve(['only'], []).groups == ({'only': Pose()},)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 6), st.integers(0, 10 ** 6))
def test_a_chain_reaches_everyone(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = team(count, rng)
    names = list(rng.permutation(list(truth)))
    constraints = []
    for one, other in zip(names, names[1:]):
        pair = constraint(truth, one, other)
        turned = MapConstraint(other, one, Pose.from_array(inverse(pair.T_target_source)), EXACT)
        constraints.append(pair if rng.random() < 0.5 else turned)
    solution = solve(truth, constraints)
    assert len(solution.groups) == 1
    assert_placed(solution.groups[0], truth)
    assert not solution.dropped


def test_the_order_of_constraints_does_not_matter(rng: np.random.Generator) -> None:
    truth = team(5, rng)
    constraints = [constraint(truth, *pair, rng.normal(0, 0.05, 3))
                   for pair in combinations(truth, 2)]
    first, second = solve(truth, constraints), solve(reversed(list(truth)), constraints[::-1])
    for name in truth:
        assert np.allclose(first.groups[0][name], second.groups[0][name], atol=1e-9)


def test_groups_come_largest_first_and_then_by_name(rng: np.random.Generator) -> None:
    truth = team(6, rng)
    solution = solve(truth, [constraint(truth, 'c', 'd'), constraint(truth, 'd', 'f')])
    assert [sorted(group) for group in solution.groups] == [['c', 'd', 'f'], ['a'], ['b'], ['e']]
    assert_placed(solution.groups[0], truth)
    assert solution.group_of('d') is solution.groups[0]
    assert solution.group_of('b') == {'b': Pose()}


def test_noise_is_averaged_over_ways_and_covariance_tells_how_well(
        rng: np.random.Generator) -> None:
    truth = team(2, rng) | {f'm{k}': Pose(*rng.uniform(-2, 2, 3)) for k in range(30)}
    sigma = np.array([0.1, 0.1, 0.01])

    def noisy(target: str, source: str) -> MapConstraint:
        exact = between(truth[target], truth[source])
        return MapConstraint(target, source, Pose.from_array(exact + rng.normal(0, sigma)),
                             np.diag(sigma ** 2))
    ways = [[noisy('a', name), noisy(name, 'b')] for name in truth if name not in 'ab']
    one, many = solve(truth, ways[0]), solve(truth, [part for way in ways for part in way])
    assert pose_error(many.groups[0]['b'], between(truth['a'], truth['b']))[0] < 0.15
    assert np.trace(many.covariances['b']) < np.trace(one.covariances['b']) / 15
    assert np.array_equal(many.covariances['a'], np.zeros((3, 3)))


def test_the_same_pair_told_twice_is_known_no_better(rng: np.random.Generator) -> None:
    truth = team(2, rng)
    once, twice = (solve('ab', [constraint(truth, 'a', 'b')] * count) for count in (1, 2))
    assert np.allclose(once.covariances['b'], twice.covariances['b'])


@pytest.mark.parametrize('wrong', list(combinations('abcd', 2)))
def test_the_constraint_that_contradicts_is_dropped_with_a_reason(
        wrong: tuple[str, str], rng: np.random.Generator) -> None:
    truth = team(4, rng)
    error = np.array([3.0, -2.0, 1.0])
    constraints = [constraint(truth, *pair, error if pair == wrong else np.zeros(3))
                   for pair in combinations(truth, 2)]
    solution = solve(truth, constraints)
    (dropped,) = solution.dropped
    assert isinstance(dropped, Dropped)
    assert (dropped.constraint.target, dropped.constraint.source) == wrong
    assert f'{wrong[0]} - {wrong[1]} (match) contradicts' in dropped.reason
    assert_placed(solution.groups[0], truth)


def test_in_one_triangle_the_least_probable_constraint_goes(rng: np.random.Generator) -> None:
    truth = team(3, rng)
    solution = solve(truth, [constraint(truth, 'a', 'b', probability=0.99),
                             constraint(truth, 'b', 'c', np.array([5.0, 0.0, 0.0]), 0.96),
                             constraint(truth, 'a', 'c', probability=0.98)])
    assert [(d.constraint.target, d.constraint.source) for d in solution.dropped] == [('b', 'c')]
    assert_placed(solution.groups[0], truth)


def test_two_wrong_constraints_among_five_robots(rng: np.random.Generator) -> None:
    truth = team(5, rng)
    bad = {('a', 'b'): np.array([4.0, 0.0, 0.0]), ('c', 'e'): np.array([0.0, 0.0, np.pi])}
    solution = solve(truth, [constraint(truth, *pair, bad.get(pair, np.zeros(3)))
                             for pair in combinations(truth, 2)])
    assert {(d.constraint.target, d.constraint.source) for d in solution.dropped} == set(bad)
    assert_placed(solution.groups[0], truth)


def test_a_liar_in_a_team_of_64_costs_little_more_work(
        monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """All pairs told by both robots: what is counted is how often the graph is linearised."""
    count = [0]
    linearise = estimate._linearise

    def counted(*args: Any) -> Any:
        count[0] += 1
        return linearise(*args)
    monkeypatch.setattr(estimate, '_linearise', counted)
    truth = {f'r{k:02d}': Pose(*rng.uniform((-50, -50, -3), (50, 50, 3))) for k in range(64)}
    liar, work = 'r63', {}
    for lies in (False, True):
        errors = {True: (9.0, 9.0, 3.0), False: (0.01, 0.01, 0.001)}
        said = [replace(constraint(truth, *pair, rng.normal(0, errors[lies and one == liar])),
                        author=one) for pair in combinations(truth, 2) for one in pair]
        count[0] = 0
        solution = solve(truth, said)
        work[lies] = count[0]
        assert {one.constraint.author for one in solution.dropped} == ({liar} if lies else set())
        for robot, pose in solution.groups[0].items():
            assert np.hypot(*between(between(truth['r00'], truth[robot]), pose)[:2]) < 0.1
    assert work[False] <= 6
    assert work[True] <= 22     # each takes some 2 ms


def test_maps_that_bend_a_little_are_no_contradiction(rng: np.random.Generator) -> None:
    truth = team(4, rng)
    solution = solve(truth, [constraint(truth, *pair, rng.normal(0, (0.2, 0.2, 0.015)))
                             for pair in combinations(truth, 2)])
    assert not solution.dropped


def test_a_bridge_is_never_dropped(rng: np.random.Generator) -> None:
    truth = team(4, rng)
    constraints = [constraint(truth, 'a', 'b'), constraint(truth, 'b', 'c'),
                   constraint(truth, 'a', 'c', np.array([9.0, 9.0, 2.0])),
                   constraint(truth, 'c', 'd')]
    solution = solve(truth, constraints)
    assert len(solution.groups[0]) == 4
    assert [d.constraint.source for d in solution.dropped] != ['d']


def liars(seed: int) -> list[MapConstraint]:
    """Three robots that agree, roughly, and two liars that place each of them surely, anywhere."""
    rng = np.random.default_rng(seed)
    truth = team(3, rng)
    honest = [replace(constraint(truth, *pair), author=one, covariance=np.diag([1.0, 1.0, 0.25]))
              for pair in combinations(truth, 2) for one in pair]
    return honest + [MapConstraint(liar, one, Pose(*rng.uniform((-15, -15, -3), (15, 15, 3))),
                                   1e-4 * np.eye(3), author=liar)
                     for liar in ('x', 'y') for one in truth]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10 ** 6))
@example(822)
def test_what_contradicts_neither_throws_a_map_away_nor_tears_a_team_apart(seed: int) -> None:
    """Whole steps of Gauss-Newton went ever farther, and then the last word on a robot went."""
    group, = solve('abcxy', liars(seed)).groups
    assert np.abs([pose[:2] for pose in group.values()]).max() < 100.0


def absurd(seed: int) -> list[MapConstraint]:
    """Say the most absurd that a message can: far away, known far too well or hardly at all."""
    rng = np.random.default_rng(seed)
    said: list[MapConstraint] = []
    while len(said) < 12:
        target, source, other = rng.choice(list('abcd'), 3, replace=False).tolist()
        A = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-4, 0, 3)
        scale = 10.0 ** rng.uniform(-9, (3, 3, 1)) / np.sqrt(np.diag(A @ A.T))
        P = A @ A.T * np.outer(scale, scale)
        try:
            sane_covariance((P + P.T) / 2.0)
        except ValueError:
            continue
        reach = 10.0 ** rng.uniform(0, 5)
        said.append(MapConstraint(
            target, source, Pose(*rng.uniform(-reach, reach, 2), rng.uniform(-3, 3)),
            (P + P.T) / 2.0, kind=str(rng.choice(['match', 'sighting'])),
            author=str(rng.choice([target, source, other]))))
    return said


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10 ** 6))
@example(5)
@example(9)
def test_whatever_a_message_may_say_is_solved(seed: int) -> None:
    """One in six such teams stopped the worker: of matrices that were not singular on paper."""
    solution = solve('abcd', absurd(seed))
    assert all(np.isfinite(pose).all() for group in solution.groups for pose in group.values())
    assert all(np.isfinite(P).all() for P in solution.covariances.values())


@pytest.mark.parametrize('bad', [
    MapConstraint('a', 'a', Pose(), EXACT), MapConstraint('a', 'z', Pose(), EXACT),
    MapConstraint('a', 'b', Pose(np.nan, 0, 0), EXACT),
    MapConstraint('a', 'b', Pose(), np.full((3, 3), np.inf))])
def test_constraints_that_no_graph_can_hold_are_refused(bad: MapConstraint) -> None:
    with pytest.raises(ValueError, match='constraint a - '):
        solve('ab', [bad])


def test_drift_grows_with_the_length_of_an_constraint() -> None:
    near, far = (with_drift(Pose(x, 0, 0), np.zeros((3, 3))) for x in (1.0, 50.0))
    assert far[0, 0] > 10 * near[0, 0]


def test_a_word_of_one_robot_lays_a_group_where_all_words_together_would() -> None:
    """Two pairs that agree, and one robot of either that says where the other pair lies."""
    P = np.diag([0.02, 0.05, 0.01])
    known = [MapConstraint('a', 'b', Pose(3.0, 1.0, 0.5), P),
             MapConstraint('c', 'd', Pose(-2.0, 4.0, 2.0), P),
             MapConstraint('d', 'b', Pose(7.0, 1.0, -1.0), P)]
    said = [replace(c, author=author) for c in known[:2] for author in c.robots]
    whole, pieces = solve('abcd', known), solve('abcd', [*said, replace(known[2], author='d')])
    for robot in 'abcd':
        assert pieces.group_of('a')[robot] == pytest.approx(whole.group_of('a')[robot], abs=1e-9)
        more = pieces.covariances[robot] - whole.covariances[robot]
        assert np.linalg.eigvalsh(more)[0] > -1e-9      # it is never called better known
        assert robot == 'd' or np.abs(more).max() < 1e-9
