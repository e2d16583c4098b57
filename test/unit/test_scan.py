# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans: what counts as a return, where the points lie, normals, free space, deskewing."""

from dataclasses import replace

import cv2
from helpers import fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import apply, Pose
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.scan import cloud, Scan

WALL = np.array([[2.0, -5.0, 2.0, 5.0]])


def scan_of(ranges) -> Scan:
    return Scan(1.0, np.array(ranges, float), -0.5, 1.0 / (len(ranges) - 1), 0.1, 4.0)


def test_only_returns_within_the_limits_are_points():
    seen = cloud(scan_of([np.nan, np.inf, -np.inf, 0.0, 0.05, 1.0, 3.9, 4.0, 81.0]), 30.0)
    assert len(seen) == 2


def test_a_shorter_limit_of_the_user_holds():
    assert len(cloud(scan_of([1.0, 2.5, 3.0]), 2.7)) == 2


def test_the_laser_mount_moves_the_points():
    scan = scan_of([1.0, 1.0, 1.0])
    mounted = replace(scan, T_base_laser=Pose(0.3, -0.1, 1.2))
    np.testing.assert_allclose(
        cloud(mounted, 30.0).points, apply((0.3, -0.1, 1.2), cloud(scan, 30.0).points))


@given(st.floats(-0.9, 0.9), st.floats(0.5, 1.9))
@settings(max_examples=25, deadline=None)
def test_normals_of_a_wall_face_the_laser(turn, distance):
    scan = fake_scan(WALL, np.array([2.0 - distance, 0.0, turn]))
    seen = cloud(scan, 30.0)
    found = (seen.normals != 0).any(1)
    expected = apply((0, 0, -turn), [[-1.0, 0.0]])[0]
    assert found.mean() > 0.8
    assert (seen.normals[found] @ expected > np.cos(np.radians(5))).all()


def test_a_lone_return_has_no_normal():
    seen = cloud(scan_of([np.nan, np.nan, 1.0, np.nan, np.nan]), 30.0)
    np.testing.assert_array_equal(seen.normals, 0.0)


def test_no_normal_is_fitted_across_two_far_walls() -> None:
    """At 15 m beams end 0.3 m apart on a wall, and 1.3 m apart where another wall begins."""
    angles = np.radians(np.arange(-4.0, 5.0))
    ranges = np.where(np.arange(9) < 6, 15.0, 13.7) / np.cos(angles)
    seen = cloud(Scan(0.0, ranges, angles[0], np.radians(1.0), 0.1, 30.0), 30.0)
    fitted = seen.normals[~seen.bare]
    assert len(fitted) == 6 and (fitted @ (-1.0, 0.0) > 0.99).all()


def test_free_space_never_crosses_a_wall():
    room = fake_room()
    seen = cloud(fake_scan(room, np.array([2.0, 2.0, 0.4])), 30.0)
    outline = apply((2.0, 2.0, 0.4), seen.outline.rim).astype(np.float32)
    for x, y in ((8.5, 3.0), (-0.3, 2.0), (4.0, -0.3), (5.35, 1.7)):  # outside, in the pillar
        assert cv2.pointPolygonTest(outline, (x, y), True) < 0.05
    assert cv2.pointPolygonTest(outline, (2.5, 2.2), False) > 0


def test_no_return_frees_nothing_unless_it_is_infinite():
    nothing = cloud(scan_of([0.0] * 9), 30.0)
    beyond = cloud(scan_of([np.inf] * 9), 30.0)
    assert np.ptp(nothing.outline.rim, axis=0).max() == 0.0
    assert np.hypot(*beyond.outline.rim.T).max() == pytest.approx(4.0, abs=3e-4)


@given(st.lists(st.tuples(st.floats(0.05, 80.0), st.sampled_from(['hit', 'open', 'dark'])),
                max_size=30), st.floats(-1.0, 1.0))
def test_what_a_scan_saw_is_kept_to_less_than_its_noise_and_stays_as_it_is(beams, x):
    reach = np.array([0.0 if kind == 'dark' else far for far, kind in beams])
    hit = np.array([kind == 'hit' for _, kind in beams], bool)
    ends = np.array([x, 0.0]) + reach[:, None] * (np.cos(0.3), np.sin(0.3))
    kept = Outline(ends, reach, hit, np.array([x, 0.0]))
    step = 2.0 ** -14 * max(1.0, np.abs(ends).max(initial=0.0), reach.max(initial=0.0))
    assert np.abs(kept.ends - ends).max(initial=0.0) <= step
    assert np.abs(kept.reach - reach).max(initial=0.0) <= step
    assert np.array_equal(kept.hit, hit) and np.array_equal(kept.reach > 0.0, reach > 0.0)
    again = Outline(kept.ends, kept.reach, kept.hit, kept.origin)     # as from a file
    for part in ('ends', 'reach', 'hit', 'origin'):
        assert np.array_equal(getattr(again, part), getattr(kept, part))


def test_deskewing_undoes_a_turn_during_the_scan():
    twist, dt = np.array([0.3, 0.0, 1.0]), 1e-4
    sharp = fake_scan(WALL, np.zeros(3))
    bearings = sharp.angle_min + sharp.angle_increment * np.arange(len(sharp.ranges))
    ranges = []
    for k, bearing in enumerate(bearings):
        t = k * dt
        x = 0.3 * np.sin(t)
        direction = bearing + t
        ranges.append((2.0 - x) / np.cos(direction) if abs(direction) < 1.0 else np.nan)
    skewed = replace(sharp, ranges=np.array(ranges), range_max=30.0, time_increment=dt)
    error = [np.abs(cloud(skewed, 30.0, t).points[:, 0] - 2.0).max() for t in (twist, None)]
    assert error[0] < 1e-3 < 0.02 < error[1]


@pytest.mark.parametrize('changes, fault', [
    ({'stamp': np.nan}, 'scan_not_finite'),
    ({'angle_increment': np.nan}, 'scan_not_finite'),
    ({'angle_increment': 0.0}, 'scan_geometry_invalid'),
    ({'range_max': 0.05}, 'scan_geometry_invalid'),
    ({'ranges': np.zeros(0)}, 'scan_empty'),
    ({'ranges': np.zeros((2, 2))}, 'scan_empty'),
])
def test_faults_have_names(changes, fault):
    assert replace(scan_of([1.0, 1.0, 1.0]), **changes).fault() == fault
