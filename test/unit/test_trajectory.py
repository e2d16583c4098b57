# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path between the scans: exact for odometry that only drifts, and never worse than it."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.geometry import between, compose, wrap
from somfusion_ros.slam.trajectory import with_odometry

T = np.linspace(0.0, 10.0, 201)
TRUTH = np.column_stack([2 * np.sin(0.5 * T), T / 3, 0.8 * np.sin(T)])


@given(st.floats(-3, 3), st.floats(-5, 5))
@settings(max_examples=20)
def test_odometry_in_another_frame_gives_the_path(theta, x):
    odometry = compose(np.array([x, -x, theta]), TRUTH)
    stamps, poses = with_odometry(T[::20], TRUTH[::20], odometry[::20], T, odometry)
    assert len(stamps) > 150 and (np.diff(stamps) > 0).all()
    truth = np.column_stack([np.interp(stamps, T, column) for column in TRUTH.T])
    np.testing.assert_allclose(poses[:, :2], truth[:, :2], atol=0.02)
    assert np.abs(wrap(poses[:, 2] - truth[:, 2])).max() < 0.02


def test_drift_is_spread_and_the_scans_stay_where_they_are():
    drifting = TRUTH * (1.05, 1.05, 1.0)
    stamps, poses = with_odometry(T[::20], TRUTH[::20], drifting[::20], T, drifting)
    at = np.isin(stamps, T[::20])
    np.testing.assert_allclose(poses[at], TRUTH[::20], atol=1e-12)
    dense = np.hypot(*between(TRUTH[np.searchsorted(T, stamps)], poses)[:, :2].T).max()
    linear = max(np.abs(np.interp(T, T[::20], TRUTH[::20, k]) - TRUTH[:, k]).max() for k in (0, 1))
    assert dense < 0.4 * linear


def test_odometry_that_jumps_does_not_shape_the_path():
    jumped = TRUTH + np.where(T > 5.2, 9.0, 0.0)[:, None] * (1, 0, 0)
    stamps, poses = with_odometry(T[::20], TRUTH[::20], jumped[::20], T, jumped)
    assert np.abs(poses[:, 0]).max() < 2.1
    assert not ((stamps > 5.0) & (stamps < 6.0)).any()


def test_without_samples_between_nothing_changes():
    stamps, poses = with_odometry(T[::20], TRUTH[::20], TRUTH[::20], T[::20], TRUTH[::20])
    np.testing.assert_array_equal(stamps, T[::20])
    np.testing.assert_array_equal(poses, TRUTH[::20])
