# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and odometry on their way to the SLAM: waiting, and stray stamps."""

import tracemalloc

from drives import Counts, Drive
from helpers import fake_room, fake_scan
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.gyro import Gyro
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.scan_queue import MAX_WAITING, ScanQueue
from somfusion_ros.slam.stamps import StampStream, TUNING


def queue_with(stamps: list[float], timeout: float = 1.0) -> tuple[ScanQueue, OdometryBuffer,
                                                                   Counts]:
    """Make a queue whose odometry has these stamps."""
    counts, buffer = Counts(), OdometryBuffer()
    for stamp in stamps:
        buffer.add(stamp, np.array([stamp, 0.0, 0.0]))
    return ScanQueue(buffer, timeout, counts), buffer, counts


def test_scans_wait_until_odometry_covers_them_in_order() -> None:
    queue, buffer, counts = queue_with([0.0, 1.0])
    for stamp in (0.5, 1.5, 1.7, 2.5):
        queue.add(stamp, stamp, now=0.0)
    assert [item for item, _ in queue.ready(0.1)] == [0.5]
    buffer.add(2.0, np.array([2.0, 0.0, 0.0]))
    found = list(queue.ready(0.2))
    assert [item for item, _ in found] == [1.5, 1.7]
    assert [float(o.pose[0]) for _, o in found] == pytest.approx([1.5, 1.7])
    assert len(queue) == 1
    assert not counts


def test_scans_that_wait_too_long_are_dropped_and_counted() -> None:
    queue, buffer, counts = queue_with([0.0, 1.0])
    queue.add(1.6, 'late', now=10.0)
    assert not list(queue.ready(16.0)), 'its odometry may come late'
    assert not counts
    assert not list(queue.ready(16.01))
    assert counts['scans_without_odometry'] == 1
    assert len(queue) == 0


def test_names_of_lasers_that_come_and_go_take_no_room() -> None:
    """A publisher may name another frame with each scan."""
    queue, buffer, counts = queue_with([0.0, 2000.0])
    tracemalloc.start()
    try:
        for k in range(2000):
            queue.add(float(k), k, now=float(k), laser=f'laser_{"x" * 1000}{k}')
            list(queue.ready(k + 5.0))
        assert tracemalloc.get_traced_memory()[0] < 500e3, 'kilobytes, not 2 MB of names'
    finally:
        tracemalloc.stop()


def test_scans_of_the_time_of_odometry_that_was_lost_go_between_what_came() -> None:
    queue, buffer, counts = queue_with([0.0, 1.0])
    queue.add(2.0, 'without', now=10.0)
    assert not list(queue.ready(12.0))
    buffer.add(3.0, np.array([3.0, 0.0, 0.0]))
    [(_, odometry)] = queue.ready(12.1)
    assert odometry.pose[0] == pytest.approx(2.0)
    assert not counts


def test_a_scan_shortly_after_the_last_odometry_is_reached_by_its_twist() -> None:
    queue, buffer, counts = queue_with([0.0, 1.0])
    queue.add(1.2, 'late', now=10.0)
    [(_, odometry)] = queue.ready(11.01)
    assert odometry.pose[0] == pytest.approx(1.2)
    assert not counts


def test_a_scan_waits_for_the_odometry_of_its_sweep_but_not_for_ever() -> None:
    queue, buffer, counts = queue_with([0.0, 1.0, 1.1])
    queue.add(1.05, 'turning', now=10.0, sweep=0.1)
    assert not list(queue.ready(10.5))
    buffer.add(1.2, np.array([1.4, 0.0, 0.0]))
    [(_, odometry)] = queue.ready(10.6)
    assert odometry.twist[0] > 1.2, 'the base is faster during the sweep than before it'
    queue.add(1.19, 'last', now=20.0, sweep=0.1)
    assert [item for item, _ in queue.ready(21.1)] == ['last'], 'better than no scan'
    assert not counts


def test_scans_older_than_all_odometry_do_not_hold_up_the_others() -> None:
    queue, _, counts = queue_with([5.0, 6.0])
    queue.add(1.0, 'old', now=0.0)
    queue.add(5.5, 'good', now=0.0)
    assert [item for item, _ in queue.ready(0.0)] == ['good']
    assert counts['scans_before_odometry'] == 1


def test_a_queue_never_grows_without_bound() -> None:
    queue, _, counts = queue_with([])
    for number in range(MAX_WAITING + 50):
        queue.add(float(number), number, now=0.0)
    assert len(queue) == MAX_WAITING
    assert counts['scans_without_odometry'] == 50, 'not for want of speed'


def judged(stamps: list[float]) -> tuple[list[float], list[float], list[float]]:
    """Judge stamps one by one; return the good, the stray, and the leaps."""
    stream, good, stray, leaps = StampStream(), [], [], []
    for stamp in stamps:
        found = stream.add(stamp, None)
        good += [stamped.stamp for stamped in found.good]
        stray += found.stray
        leaps += [found.leap] if found.leap else []
    return good, stray, leaps


@given(st.sampled_from([-1e9, -3600.0, -0.3, 100.0, 9e9]), st.integers(8, 40), st.integers(1, 2))
def test_stray_stamps_are_left_out_and_nothing_else(off: float, at: int, count: int) -> None:
    """One stamp that is off, or two that are alike, among regular ones."""
    regular = [100.0 + 0.1 * k for k in range(50)]
    stamps = [*regular[:at], *[regular[at] + off] * count, *regular[at:]]
    good, stray, leaps = judged(stamps)
    assert (good, leaps) == (regular, [])
    assert len(stray) == count


@given(st.sampled_from([-3600.0, -30.0, -0.5, 30.0, 3600.0, 1e6]), st.integers(8, 40))
def test_a_clock_that_is_set_loses_no_message(step: float, at: int) -> None:
    stamps = [1e4 + 0.1 * k + step * (k >= at) for k in range(50)]
    good, stray, leaps = judged(stamps)
    assert (good, stray) == (stamps, [])
    assert leaps == pytest.approx([step + 0.1])


def test_pauses_of_every_length_are_no_fault() -> None:
    """A log with a scan per metre: steps from 0.5 s to 100 s."""
    stamps = np.cumsum(np.random.default_rng(0).choice([0.5, 1.0, 1.5, 20.0, 100.0], 200))
    good, stray, _ = judged([*stamps, stamps[-1] + 0.5])
    assert not stray
    assert good == [*stamps, stamps[-1] + 0.5]


def test_a_pause_in_a_stream_that_repeats_its_stamps_is_no_fault() -> None:
    """Odometry of the Intel log comes in bursts of one stamp."""
    stamps = np.repeat(np.concatenate([np.arange(0.0, 3.0, 0.3), np.arange(6.0, 9.0, 0.3)]), 3)
    good, stray, _ = judged(list(stamps))
    assert (good, stray) == (list(stamps), [])


def test_strange_stamps_without_order_are_never_a_leap() -> None:
    good, _, leaps = judged([100.0, 50.0, 40.0, 30.0, 20.0, 10.0, 5.0, 4.0, 3.0])
    assert (good, leaps) == ([100.0], [])


def test_a_wrong_first_stamp_is_overcome() -> None:
    good, _, _ = judged([9e9, *(1.0 + 0.1 * k for k in range(TUNING.backward + 1))])
    assert good[1:] == pytest.approx([1.0 + 0.1 * k for k in range(TUNING.backward + 1)])


def test_a_session_follows_the_robot() -> None:
    drive = Drive()
    drive.feed(0, 100)
    tags = [tag for tag, _ in drive.steps]   # the last may wait for odometry that covers the lag
    assert tags == list(range(len(tags)))
    assert len(tags) >= 99
    assert all(step.accepted for _, step in drive.steps)
    assert drive.error() < 0.1


def test_a_clock_set_back_does_not_lose_the_map() -> None:
    drive = Drive()
    drive.feed(0, 50)
    views = len(drive.session.slam.views()[0])
    drive.feed(50, 100, shift=-1000.0)
    assert drive.counts['scan_time_jumped_back'] == 1
    assert not drive.counts['maps_begun_anew']
    assert drive.steps[-1][0] >= 98   # the last may wait for odometry that covers the lag
    assert len(drive.session.slam.views()[0]) > views
    assert drive.error() < 0.15


def test_scans_that_jump_before_the_odometry_wait_for_it() -> None:
    drive = Drive()
    drive.feed(0, 50)
    for i in range(50, 80):
        scan = fake_scan(fake_room(), drive.poses[i], drive.stamps[i] - 3.0, beams=181)
        drive.session.add_scan(scan, i, 0.0)
        drive.steps += list(drive.session.steps(0.0))
    assert drive.steps[-1][0] == 49
    for i in range(50, 80):
        drive.session.add_odometry(drive.stamps[i] - 3.0, drive.odometry[i])
        drive.steps += list(drive.session.steps(0.0))
    assert drive.steps[-1][0] == 79
    assert not drive.counts['maps_begun_anew']
    assert drive.error() < 0.15


def test_a_simulation_that_starts_again_begins_a_new_map() -> None:
    drive = Drive()
    drive.feed(0, 60)
    drive.feed(0, 40, T_odom_odom=Pose(30.0, 0.0, 0.0), shift=-0.001)
    assert drive.counts['maps_begun_anew'] == 1
    assert drive.steps[-1][0] == 39
    assert len(drive.session.slam.trajectory()[0]) == 40


def test_single_stray_stamps_change_nothing() -> None:
    drive = Drive()
    drive.feed(0, 30)
    drive.session.add_odometry(9e9, np.zeros(3))
    drive.session.add_scan(fake_scan(fake_room(), drive.poses[30], 9e9), 'stray', 0.0)
    drive.session.add_scan(fake_scan(fake_room(), drive.poses[30], np.nan), 'stray', 0.0)
    drive.session.add_odometry(0.0, np.zeros(3))
    drive.feed(30, 60)
    assert [tag for tag, _ in drive.steps] == list(range(60))
    assert drive.counts['scan_stamps_stray'] == 2
    assert drive.counts['odometry_stamps_stray'] == 2
    assert drive.error() < 0.1


def test_bad_scans_between_good_ones_are_counted() -> None:
    drive = Drive()
    drive.feed(0, 10)
    good = fake_scan(fake_room(), drive.poses[9], drive.stamps[9], beams=181)
    for ranges in ([], [np.nan] * 181, [np.inf] * 181, [0.0] * 181, [1.0] * 7):
        spoiled = type(good)(good.stamp, np.array(ranges), good.angle_min, good.angle_increment,
                             good.range_min, good.range_max)
        drive.session.add_scan(spoiled, 'bad', 0.0)
        drive.steps += [s for s in drive.session.steps(0.0) if s[0] != 'bad']
    drive.feed(10, 40)
    assert sum(drive.counts.values()) >= 5
    assert drive.error() < 0.1


def test_a_laser_that_fell_silent_is_not_waited_for() -> None:
    """Every scan of the other one waited for 0.3 s, for good."""
    queue, buffer, _ = queue_with([0.0, 100.0])
    queue.add(1.0, 'back', now=1.0, laser='back')
    queue.add(1.1, 'front', now=1.1, laser='front')
    assert [item for item, _ in queue.ready(1.1)] == ['back'], 'another may come'
    queue.add(20.0, 'later', now=20.0, laser='front')
    assert [item for item, _ in queue.ready(20.0)] == ['front', 'later']


def test_a_gyroscope_learns_by_its_own_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, ahead = Drive(), []
    drive.session.slam._map.tracker.calibration.turning[0] = 0.3
    monkeypatch.setattr(Gyro, 'learn', lambda gyro, step, at: ahead.append(at - step.stamp))
    drive.feed(0, 5)
    assert ahead[:2] == pytest.approx([0.3, 0.3])
