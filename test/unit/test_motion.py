# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry: interpolation, dead reckoning of two wheels, and how its noise grows."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, wrap
from somfusion_ros.slam.motion import (arc, increment_covariance, MotionNoise, Odometry,
                                       OdometryBuffer)
from somfusion_ros.slam.wheel_odometry import WHEEL_SLIP, WheelOdometry


def filled(count: Counter) -> OdometryBuffer:
    buffer = OdometryBuffer(lambda name: count.update([name]))
    for t in range(5):
        buffer.add(float(t), (2.0 * t, 0.0, 0.0))
    return buffer


@given(st.floats(0.0, 4.0))
def test_interpolation_lies_between_the_samples(stamp):
    found = filled(Counter()).at(stamp)
    assert found.pose[0] == pytest.approx(2.0 * stamp, abs=1e-9)
    assert found.twist[0] == pytest.approx(2.0)


@given(st.floats(0.0, 1.0), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_between_samples_the_robot_drives_one_arc(stamp, turn, travel):
    buffer, ends = OdometryBuffer(), (np.array([1.0, 2.0, 3.0]),)
    ends += (compose(ends[0], arc(travel, turn)),)
    for t, pose in enumerate(ends):
        buffer.add(float(t), pose)
    found = buffer.at(stamp).pose
    expected = compose(ends[0], arc(travel * stamp, turn * stamp))
    assert abs(wrap(found[2] - expected[2])) < 1e-9
    np.testing.assert_allclose(found[:2], expected[:2], atol=1e-9)


@pytest.mark.parametrize('stamp', [-0.1, 4.1])
def test_nothing_is_extrapolated(stamp):
    assert filled(Counter()).at(stamp) is None


@given(st.floats(0.0, 4.0), st.floats(-0.5, 0.5))
def test_a_lag_reads_the_odometry_of_another_time(stamp, lag):
    buffer = filled(Counter())
    buffer.lag = lag
    if stamp + lag > 4.0:
        assert buffer.at(stamp) is None
    else:
        assert buffer.at(stamp).pose[0] == pytest.approx(2.0 * (stamp + lag), abs=1e-9)


@given(st.floats(-0.2, 0.1), st.lists(st.floats(-0.15, 0.15), min_size=40, max_size=40))
def test_samples_that_arrive_in_bursts_keep_the_one_that_belongs_to_the_stamp(lag, jitter):
    """True poses at true times, stamped late or early; the looked-up one is stamped rightly."""
    buffer, times = OdometryBuffer(), np.arange(40) * 0.25
    stamps = np.sort(times + jitter)
    stamps[20] = np.clip(times[20], stamps[19] + 1e-3, stamps[21] - 1e-3)
    buffer.lag = lag
    for t, stamp in zip(times, stamps, strict=True):
        buffer.add(stamp, (1.0 * t, 0.0, 0.0))
    found = buffer.at(stamps[20])
    assert found.pose[0] == pytest.approx(times[20], abs=3.0 * abs(lag) + 1e-9)
    assert 0.2 < found.twist[0] < 3.0


def test_headings_are_interpolated_across_the_turn():
    buffer = OdometryBuffer()
    buffer.add(0.0, (0.0, 0.0, 3.1))
    buffer.add(1.0, (0.0, 0.0, -3.1))
    assert abs(abs(buffer.at(0.5).pose[2]) - np.pi) < 1e-9


def test_bad_samples_are_counted_and_change_nothing():
    count = Counter()
    buffer = filled(count)
    assert not buffer.add(4.0, (9, 9, 9))
    assert not buffer.add(1.0, (9, 9, 9))
    assert not buffer.add(5.0, (np.nan, 0, 0))
    assert not buffer.add(np.inf, (0, 0, 0))
    assert count == {'odometry_stamps_repeated': 1, 'odometry_stamps_backward': 1,
                     'odometry_not_finite': 2}
    assert buffer.latest == 4.0 and buffer.at(4.0).pose[0] == 8.0


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_wheels_drive_the_arc_that_their_travels_give(left, right):
    wheels = WheelOdometry(0.1, 0.4)
    wheels.update(1.0, 2.0)
    pose = wheels.update(1.0 + left, 2.0 + right)
    np.testing.assert_allclose(
        pose, arc(0.05 * (left + right), 0.25 * (right - left)), atol=1e-12)


def test_many_small_arcs_make_one():
    step, whole = arc(0.01, 0.02), np.zeros(3)
    for _ in range(50):
        whole = compose(whole, step)
    np.testing.assert_allclose(whole, arc(0.5, 1.0), atol=1e-12)


def test_a_wheel_without_a_number_is_skipped():
    wheels = WheelOdometry(0.1, 0.4)
    wheels.update(0.0, 0.0)
    assert np.isnan(wheels.update(np.nan, 1.0)).all()
    np.testing.assert_allclose(wheels.update(1.0, 1.0), (0.1, 0.0, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize('rounds, straight', [(10, 0.0), (0, 40.0), (3, 20.0)])
def test_the_slip_of_each_wheel_gives_an_honest_covariance(rounds, straight):
    """Of 300 drives, turning in place or not, the mean NEES of travel and turn is that of two."""
    rng, steps = np.random.default_rng(0), 400
    turn, travel = np.full(steps, 2.0 * np.pi * rounds / steps), np.full(steps, straight / steps)
    true = np.column_stack([travel - 0.2 * turn, travel + 0.2 * turn])
    nees = []
    for _ in range(300):
        real = true + rng.normal(size=true.shape) * WHEEL_SLIP * np.sqrt(np.abs(true))
        wheels = WheelOdometry(0.1, 0.4)
        for angles in np.cumsum(np.vstack([np.zeros(2), real]), axis=0) / 0.1:
            wheels.update(*angles)
        xx, xy, yy = wheels.slip
        told = real.sum(0) @ np.array([[0.5, -2.5], [0.5, 2.5]])
        e = told - (travel.sum(), turn.sum())
        nees.append(e @ np.linalg.solve([[xx, xy], [xy, yy]], e))
    assert 1.7 < np.mean(nees) < 2.35, 'a mean of 2; the band of 300 drives is 1.78 .. 2.23'


@pytest.mark.parametrize('readings', [50, 500])
def test_turning_in_place_is_as_uncertain_however_often_it_is_read(readings):
    wheels, quiet, variance = WheelOdometry(0.1, 0.4), MotionNoise(floor=0, floor_heading=0), 0.0
    last = Odometry(0.0, wheels.update(0.0, 0.0), np.zeros(3), wheels.slip)
    for turn in np.linspace(0.0, 20.0 * np.pi, readings + 1)[1:]:
        now = Odometry(turn, wheels.update(-2.0 * turn, 2.0 * turn), np.zeros(3), wheels.slip)
        step = between(last.pose, now.pose)
        variance += increment_covariance(step, quiet, now.slip_since(last))[2, 2]
        last = now
    way = 20.0 * np.pi * 0.2                  # [m] that each wheel goes in ten turns
    assert variance == pytest.approx(2.0 * WHEEL_SLIP ** 2 * way / 0.4 ** 2)


def test_wheels_need_a_size():
    with pytest.raises(ValueError, match='positive'):
        WheelOdometry(0.0, 0.4)


@given(st.floats(0.01, 2.0), st.floats(-3, 3), st.floats(1.1, 3.0))
def test_noise_grows_with_travel_and_is_a_covariance(travel, turn, factor):
    near, far = (increment_covariance(np.array([k * travel, 0.0, turn]), MotionNoise())
                 for k in (1.0, factor))
    assert (np.linalg.eigvalsh(near) > 0).all()
    assert np.trace(far) > np.trace(near)


def test_noise_lies_along_the_travel():
    Q = increment_covariance(np.array([0.0, 1.0, 0.0]), MotionNoise())
    assert Q[1, 1] > Q[0, 0]
    assert between((0, 0, 0), (0, 1, 0))[1] == 1.0


@pytest.mark.parametrize('turn', [0.0, 0.1, -0.1])
def test_odometry_goes_on_along_its_arc(turn: float) -> None:
    buffer = OdometryBuffer()
    for k in range(20):
        buffer.add(0.1 * k, arc(0.1 * k, turn * k))
    found = buffer.extrapolated(2.4)
    assert found is not None
    np.testing.assert_allclose(found.pose, arc(2.4, 24.0 * turn), atol=1e-9)


def test_an_array_that_is_used_again_changes_no_odometry() -> None:
    buffer, pose = OdometryBuffer(), np.zeros(3)
    for t in range(3):
        pose[0] = t
        buffer.add(float(t), pose)
    assert buffer.at(0.5).pose[0] == pytest.approx(0.5)
