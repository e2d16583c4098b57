# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The filter against dense algebra, and the re-solved problem against both."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import between, between_jacobians, compose, wrap
from somfusion_ros.slam import smoothing
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.ekf import AT_ONCE, DelayedStateEkf

Q = np.diag([0.02, 0.01, 0.01]) ** 2
STEP = np.array([0.5, 0.0, 2 * np.pi / 40])


def chain(n: int, rng: np.random.Generator) -> tuple[DelayedStateEkf, list[Constraint]]:
    """Drive a circle with noisy steps."""
    ekf, constraints = DelayedStateEkf(anchors=1), []
    ekf.augment(np.zeros(3), Q)
    for k in range(1, n):
        z = STEP + rng.multivariate_normal(np.zeros(3), Q)
        ekf.augment(z, Q)
        constraints.append(Constraint(k - 1, k, z, Q))
    return ekf, constraints


def dense(ekf: DelayedStateEkf) -> np.ndarray:
    return np.block([[ekf.block(i, j) for j in range(ekf.n)] for i in range(ekf.n)])


@given(st.integers(0, 1000), st.integers(5, 90))
@settings(max_examples=15, deadline=None)
def test_an_update_is_the_kalman_update(seed, n):
    rng = np.random.default_rng(seed)
    ekf, _ = chain(n, rng)
    i, j = sorted(rng.choice(n, 2, replace=False))
    R = np.diag([0.01, 0.01, 0.005]) ** 2
    z = compose(between(ekf.poses[i], ekf.poses[j]), rng.normal(0, 0.01, 3))
    x, P = ekf.poses.copy(), dense(ekf)
    H = np.zeros((3, 3 * n))
    H[:, 3 * i:3 * i + 3], H[:, 3 * j:3 * j + 3] = between_jacobians(x[i], x[j])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    innovation = z - between(x[i], x[j])
    innovation[2] = wrap(innovation[2])
    expected = x + (K @ innovation).reshape(-1, 3)
    ekf.update(Constraint(int(i), int(j), z, R))
    error = ekf.poses - expected
    error[:, 2] = wrap(error[:, 2])   # a heading of pi may be written as -pi
    np.testing.assert_allclose(error, 0.0, atol=1e-9)
    np.testing.assert_allclose(dense(ekf), (np.eye(3 * n) - K @ H) @ P, atol=1e-10)


@pytest.mark.slow
def test_covariance_stays_symmetric_and_positive():
    ekf, _ = chain(120, np.random.default_rng(3))
    for i in range(40):
        ekf.update(Constraint(i, i + 79, between(ekf.poses[i], ekf.poses[i + 79]), Q))
    P = dense(ekf)
    np.testing.assert_allclose(P, P.T, atol=1e-12)
    assert np.linalg.eigvalsh(P).min() > -1e-12


def test_a_loop_shrinks_the_uncertainty_and_the_error():
    ekf, _ = chain(41, np.random.default_rng(5))
    error = np.hypot(*ekf.poses[40, :2])
    before = np.trace(ekf.block(40, 40))
    ekf.update(Constraint(0, 40, np.zeros(3), np.diag([0.005, 0.005, 0.002]) ** 2))
    assert np.trace(ekf.block(40, 40)) < 0.05 * before
    assert np.hypot(*ekf.poses[40, :2]) < 0.1 * error


def test_the_filter_and_the_whole_solution_agree_on_small_loops():
    ekf, constraints = chain(41, np.random.default_rng(7))
    loop = Constraint(0, 40, between(ekf.poses[0], ekf.poses[40]) + (0.02, -0.02, 0.005), Q)
    solved = smoothing.solve(ekf.poses, [*constraints, loop])
    ekf.update(loop)
    np.testing.assert_allclose(ekf.poses, solved, atol=2e-3)
    P = smoothing.covariance(solved, [*constraints, loop])
    np.testing.assert_allclose(np.tril(dense(ekf)), np.tril(P), atol=2e-4)


def test_relinearising_takes_out_what_the_filter_cannot():
    """After a large loop closure the re-solved path is nearer the truth than the update."""
    rng = np.random.default_rng(11)
    ekf, constraints = DelayedStateEkf(), []
    ekf.augment(np.zeros(3), Q)
    truth = [np.zeros(3)]
    for k in range(1, 121):
        truth.append(compose(truth[-1], STEP / (1, 1, 3)))
        z = STEP / (1, 1, 3) + (0.0, 0.0, 0.006) + rng.multivariate_normal(np.zeros(3), Q)
        ekf.augment(z, Q)
        constraints.append(Constraint(k - 1, k, z, Q))
    R = np.diag([0.01, 0.01, 0.005]) ** 2
    loops = [Constraint(k, 120 - 5 + k, between(truth[k], truth[115 + k]), R) for k in range(5)]
    for loop in loops:
        ekf.update(loop)
    filtered = ekf.poses.copy()
    ekf.relinearise(smoothing.solve(ekf.poses, [*constraints, *loops], iterations=20))
    truth = np.array(truth)
    error = [np.hypot(*(poses - truth)[:, :2].T).mean() for poses in (filtered, ekf.poses)]
    assert error[1] < 0.7 * error[0]


def test_views_that_came_meanwhile_follow_rigidly():
    ekf, _ = chain(10, np.random.default_rng(0))
    tail = between(ekf.poses[6], ekf.poses[7:])
    ekf.relinearise(ekf.poses[:7] + (1.0, 2.0, 0.0))
    np.testing.assert_allclose(between(ekf.poses[6], ekf.poses[7:]), tail, atol=1e-12)


def test_a_false_loop_counts_less_than_the_rest():
    _, constraints = chain(41, np.random.default_rng(7))
    start = [np.zeros(3)]
    for r in constraints:
        start.append(compose(start[-1], r.z))
    good = [Constraint(0, 40, np.zeros(3), Q), Constraint(1, 39, compose(-STEP, -STEP), Q)]
    good[1] = Constraint(0, 39, between(STEP, np.zeros(3)), Q)
    bad = Constraint(5, 20, np.array([3.0, 0.0, 0.0]), Q)
    clean = smoothing.solve(np.array(start), [*constraints, *good])
    spoilt = smoothing.solve(np.array(start), [*constraints, *good, bad], iterations=20)
    assert np.abs(clean - spoilt)[:, :2].max() < 0.25


def test_marginalised_views_hang_between_their_anchors():
    """An anchored filter tells the newest pose and its covariance as the full one does."""
    rng, full, anchored = np.random.default_rng(4), DelayedStateEkf(1), DelayedStateEkf(4)
    for _ in range(200):
        z = STEP + rng.multivariate_normal(np.zeros(3), Q)
        for ekf in (full, anchored):
            ekf.augment(z, Q)
    assert anchored.kept.sum() < 110 and full.kept.all()
    for i, j in ((0, 160), (40, 199), (20, 180)):
        z = between(full.poses[i], full.poses[j]) + rng.normal(0.0, 0.01, 3)
        for ekf in (full, anchored):
            ekf.update(Constraint(i, j, z, Q))
    np.testing.assert_allclose(anchored.block(199, 199), full.block(199, 199), rtol=1e-6)
    np.testing.assert_allclose(anchored.poses[anchored.kept], full.poses[anchored.kept], atol=1e-6)
    np.testing.assert_allclose(anchored.poses, full.poses, atol=0.02)
    late = Constraint(41, 130, between(anchored.poses[41], anchored.poses[130]), Q)
    assert not anchored.kept[[41, 130]].any(), 'a loop found late, between marginalised views'
    assert anchored.update(late) < 0.05 and (np.diag(anchored.relative(41, 130)[1]) > 0).all()


def test_a_filter_that_is_full_lets_every_second_anchor_go(monkeypatch):
    """Four rounds of a block, and views added later where the place was known."""
    monkeypatch.setattr('somfusion_ros.slam.ekf.MOST', 110)
    rng, full, thinned = np.random.default_rng(4), DelayedStateEkf(1), DelayedStateEkf()
    for k in range(500):
        view = int(rng.integers(60, 300)) if k > 300 and k % 40 == 0 else None
        z = STEP + rng.multivariate_normal(np.zeros(3), Q)
        before = thinned.kept.sum()
        for ekf in (full, thinned):
            ekf.augment(z, Q, view)
        assert before - thinned.kept.sum() <= AT_ONCE, 'no single scan pays for all'
        if k % 25 == 24 and k > 100:
            z = between(full.poses[k - 100], full.poses[k]) + rng.normal(0.0, 0.01, 3)
            for ekf in (full, thinned):
                ekf.update(Constraint(k - 100, k, z, Q))
    assert thinned.kept.sum() <= 110 + AT_ONCE
    np.testing.assert_allclose(np.sqrt(np.diag(thinned.block(499, 499))),
                               np.sqrt(np.diag(full.block(499, 499))), rtol=0.1)
    assert np.hypot(*(thinned.poses - full.poses)[:, :2].T).max() < 0.05
    for i, j in ((4, 130), (77, 290), (200, 480)):      # marginalised, most of them
        sigma, honest = (np.sqrt(np.diag(ekf.relative(i, j)[1])) for ekf in (thinned, full))
        assert (sigma < 3.0 * honest).all() and (sigma > 0.4 * honest).all()


def test_views_added_where_the_place_was_known_hang_on_it():
    """Hours after the first round: a view here and there, each from one of the first."""
    rng, full, anchored = np.random.default_rng(9), DelayedStateEkf(1), DelayedStateEkf(4)
    for k in range(400):
        view = None if k < 81 else int(rng.integers(k - 1)) if k < 320 else k - 1
        z = STEP + rng.multivariate_normal(np.zeros(3), Q)
        for ekf in (full, anchored):
            ekf.augment(z, Q, view)
    assert anchored.kept.sum() < 81 / 3 + 80 / 3 + 64      # nothing of the 240 between
    for i, j in ((4, 60), (20, 380), (8, 340)):
        z = between(full.poses[i], full.poses[j]) + rng.normal(0.0, 0.01, 3)
        for ekf in (full, anchored):
            ekf.update(Constraint(i, j, z, Q))
    d = anchored.poses - full.poses
    assert np.hypot(*d[:81, :2].T).max() < 0.02
    assert np.percentile(np.hypot(*d[81:, :2].T), 95) < 0.05
    np.testing.assert_allclose(anchored.block(399, 399), full.block(399, 399), rtol=0.2)
    sigma, honest = (np.array([np.sqrt(np.diag(ekf.relative(0, k)[1])) for k in range(90, 320)])
                     for ekf in (anchored, full))
    share = sigma / honest                # it claims to know none of them much better than it does
    assert share.min() > 0.4
    assert (np.abs(np.median(share, axis=0) - 1.0) < 0.15).all()


def test_a_filter_of_few_views_is_made_again():
    for n in (1, 2):
        steps = [Constraint(k - 1, k, STEP, Q) for k in range(1, n)]
        again = DelayedStateEkf.of(STEP * np.arange(n)[:, None], steps)
        assert again.augment(STEP, Q) == n
        np.testing.assert_allclose(again.block(n, n)[2, 2], n * Q[2, 2], rtol=1e-6)


def test_a_filter_made_again_of_its_constraints_knows_as_much():
    rng, lived, constraints = np.random.default_rng(7), DelayedStateEkf(), []
    lived.augment(np.zeros(3), Q)
    for k in range(1, 160):
        made = [Constraint(k - 1, k, STEP + rng.multivariate_normal(np.zeros(3), Q), Q)]
        lived.augment(made[0].z, Q)
        if k % 7 == 0 and k >= 80:      # the second round sees the first
            z = between(lived.poses[k - 80], lived.poses[k]) + rng.normal(0.0, 0.005, 3)
            made.append(Constraint(k - 80, k, z, Q))
            lived.update(made[1])
        constraints += made
    again = DelayedStateEkf.of(lived.poses.copy(), constraints)
    np.testing.assert_allclose(again.poses, lived.poses, atol=1e-12)
    assert np.array_equal(again.kept, lived.kept)
    for i, j in ((0, 159), (3, 90), (60, 140)):
        (seen, P), (seen_again, P_again) = lived.relative(i, j), again.relative(i, j)
        np.testing.assert_allclose(seen_again, seen, atol=1e-12)
        np.testing.assert_allclose(np.sqrt(np.diag(P_again)), np.sqrt(np.diag(P)), rtol=0.1)
