# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Matching: known poses are found, and the covariance says what the surface does not fix."""

from helpers import fake_room, fake_scan, pose_error
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import between
from somfusion_ros.slam.correlative import search
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import refine, register
from somfusion_ros.slam.scan import cloud

ROOM = fake_room()
HALL = np.array([[-50.0, -1.0, 50.0, -1.0], [-50.0, 1.0, 50.0, 1.0]])
PLACES = ((1.5, 1.5, 0.3), (2.5, 1.2, -0.4), (2.0, 2.5, 1.0))


def room_map(noise: float = 0.01) -> LocalMap:
    rng = np.random.default_rng(1)
    clouds = [cloud(fake_scan(ROOM, np.array(p), noise=noise, rng=rng), 30.0) for p in PLACES]
    return LocalMap.of_views(clouds, [np.array(p) for p in PLACES])


TARGET = room_map()


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.15, 0.15), st.integers(0, 99))
@settings(max_examples=25, deadline=None)
def test_a_scan_is_placed_from_a_seed_nearby(dx, dy, dtheta, seed):
    truth = np.array([2.0, 1.8, 0.2])
    scan = cloud(fake_scan(ROOM, truth, noise=0.01, rng=np.random.default_rng(seed)), 30.0)
    match = register(scan, TARGET, truth + (dx, dy, dtheta))
    distance, angle = pose_error(match.T_map_scan, truth)
    assert distance < 0.015 and angle < np.radians(0.5)
    assert match.inlier_ratio > 0.9


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
@settings(max_examples=15, deadline=None)
def test_the_search_finds_the_pose_wherever_the_seed_lies(dx, dy, dtheta):
    truth = np.array([2.0, 1.8, 0.2])
    scan = cloud(fake_scan(ROOM, truth, noise=0.01), 30.0)
    peak = search(scan, TARGET, truth + (dx, dy, dtheta), 1.2, 1.2)
    distance, angle = pose_error(peak.pose, truth)
    assert distance < 0.1 and angle < np.radians(3)
    assert peak.rival < 0.9 * peak.score
    quick = search(scan, TARGET, truth + (dx, dy, dtheta), 1.2, 1.2, with_rival=False)
    assert abs(quick.score - peak.score) < 1e-5, 'what is left out early holds nothing better'


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_seed_that_is_not_finite_matches_nothing(axis, value):
    """kiss-icp itself would abort the process."""
    seed = np.array([2.0, 1.8, 0.2])
    scan = cloud(fake_scan(ROOM, seed), 30.0)
    seed[axis] = value
    match = register(scan, TARGET, seed)
    assert match.inlier_ratio == 0.0 and not match.information.any()


def test_a_corridor_says_nothing_along_itself():
    scan = cloud(fake_scan(HALL, np.array([0.3, 0.1, 0.0]), noise=0.01), 30.0)
    target = LocalMap.of_views([cloud(fake_scan(HALL, np.zeros(3), noise=0.01), 30.0)],
                               [np.zeros(3)])
    match = refine(scan, target, np.array([0.3, 0.05, 0.02]))
    along, across = match.information[0, 0], match.information[1, 1]
    assert along < 1e-3 * across, 'free along the corridor'
    assert across > 1 / 0.02 ** 2 and abs(match.T_map_scan[1] - 0.1) < 0.02, 'fixed across it'


def test_a_prior_holds_where_the_surface_does_not():
    scan = cloud(fake_scan(HALL, np.array([0.3, 0.1, 0.0]), noise=0.01), 30.0)
    target = LocalMap.of_views([cloud(fake_scan(HALL, np.zeros(3), noise=0.01), 30.0)],
                               [np.zeros(3)])
    match = refine(scan, target, np.array([0.3, 0.05, 0.02]), hold=1e3 * np.eye(3))
    assert abs(match.T_map_scan[0] - 0.3) < 0.03


def test_the_covariance_covers_the_errors():
    truth, errors = np.array([2.0, 1.8, 0.2]), []
    for seed in range(40):
        scan = cloud(fake_scan(ROOM, truth, noise=0.015, rng=np.random.default_rng(seed)), 30.0)
        match = register(scan, TARGET, truth + (0.05, -0.04, 0.03))
        e = between(truth, match.T_map_scan)
        errors.append(e @ np.linalg.solve(match.covariance, e))
    assert np.mean(errors) < 3.0, 'mean NEES of 3 degrees of freedom'


def test_another_room_is_no_match():
    other = cloud(fake_scan(fake_room(3.0, 2.5), np.array([1.0, 1.0, 0.5])), 30.0)
    assert register(other, TARGET, np.array([3.9, 3.2, 0.0])).inlier_ratio < 0.6


def test_too_few_points_are_no_match():
    scan = cloud(fake_scan(ROOM, np.array([2.0, 1.8, 0.2]), beams=5), 30.0)
    match = register(scan, TARGET, np.zeros(3))
    assert match.inlier_ratio == 0.0 and not match.information.any()


def test_space_seen_through_is_told_from_space_unseen():
    inside, outside = np.array([[2.0, 2.0]]), np.array([[2.0, -2.0]])
    assert TARGET.seen_through(inside).all() and not TARGET.seen_through(outside).any()
