# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SE(2): group laws, derivatives, and fits, to rounding."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import (apply, between, between_jacobians, compose, compose_jacobians,
                                    fit, inverse, Pose, rotation, squared_mahalanobis, wrap)

number = st.floats(-50.0, 50.0)
pose = st.tuples(number, number, st.floats(-10.0, 10.0)).map(np.array)


@given(pose)
def test_a_pose_and_its_inverse_cancel(T):
    np.testing.assert_allclose(compose(T, inverse(T)), 0.0, atol=1e-9)


@given(pose, pose, pose)
def test_composition_is_associative(a, b, c):
    left, right = compose(compose(a, b), c), compose(a, compose(b, c))
    np.testing.assert_allclose(left[:2], right[:2], atol=1e-9)
    assert abs(wrap(left[2] - right[2])) < 1e-9


@given(pose, pose)
def test_between_is_what_composes_back(a, b):
    back = compose(a, between(a, b))
    np.testing.assert_allclose(back[:2], b[:2], atol=1e-9)
    assert abs(wrap(back[2] - b[2])) < 1e-9


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_direction(angle):
    assert -np.pi <= wrap(angle) < np.pi
    np.testing.assert_allclose(np.exp(1j * wrap(angle)), np.exp(1j * angle), atol=1e-9)


@given(pose, pose)
def test_jacobians_are_the_derivatives(a, b):
    for function, jacobians in ((compose, compose_jacobians), (between, between_jacobians)):
        for which, J in enumerate(jacobians(a, b)):
            for k in range(3):
                step = np.zeros(3)
                step[k] = 1e-5
                args = [[a + step, b], [a, b + step]][which], [[a - step, b], [a, b - step]][which]
                change = function(*args[0]) - function(*args[1])
                change[2] = wrap(change[2])
                np.testing.assert_allclose(J[:, k], change / 2e-5, atol=1e-5)


@given(pose)
def test_fit_recovers_the_pose_of_exact_points(T):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.3, 2.0], [-1.0, 1.0]])
    found = fit(points, apply(T, points))
    np.testing.assert_allclose(found[:2], T[:2], atol=1e-8)
    assert abs(wrap(found.theta - T[2])) < 1e-8


def test_fit_heeds_the_weights():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 5.0]])
    moved = apply(Pose(0.5, -0.2, 0.3), points)
    moved[3] += 10.0
    found = fit(points, moved, [1.0, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(found, (0.5, -0.2, 0.3), atol=1e-9)


def test_fit_refuses_what_cannot_be_fitted():
    with pytest.raises(ValueError, match='at least two points'):
        fit(np.zeros((1, 2)), np.zeros((1, 2)))


@pytest.mark.parametrize('bad', [(np.nan, 0, 0), (0, np.inf, 0)])
def test_a_pose_must_be_finite(bad):
    with pytest.raises(ValueError, match='finite'):
        Pose.from_array(bad)


def test_rotation_turns_counter_clockwise():
    np.testing.assert_allclose(rotation(np.pi / 2) @ [1.0, 0.0], [0.0, 1.0], atol=1e-12)


@given(pose, pose)
def test_single_poses_give_what_arrays_of_poses_give(a, b):
    for one, many in ((compose(a, b), compose(a[None], b[None])[0]),
                      (between(a, b), between(a[None], b[None])[0]),
                      (inverse(a), inverse(a[None])[0])):
        np.testing.assert_allclose(one[:2], many[:2], atol=1e-12)
        assert abs(wrap(one[2] - many[2])) < 1e-12
    np.testing.assert_allclose(rotation(a[2]), rotation(a[2:])[0], atol=1e-15)


@given(st.integers(0, 999), st.floats(-3.0, 6.0))
def test_mahalanobis_distance_is_that_of_the_inverse(seed, exponent):
    rng = np.random.default_rng(seed)
    A, y = rng.normal(size=(3, 3)), rng.normal(size=3)
    S = A @ A.T + np.diag([1e-3, 1e-3, 1e-3]) + np.diag([10.0 ** exponent, 0.0, 0.0])
    np.testing.assert_allclose(squared_mahalanobis(y, S), y @ np.linalg.solve(S, y), rtol=1e-6)
