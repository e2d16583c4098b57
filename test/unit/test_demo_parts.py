# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes are made of, without ROS: waiting scans, jumps of time, peers, the worker."""

from collections import Counter
import threading

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.ros.common.worker import Worker
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.scan_queue import JUMP_CONFIRMED, MAX_WAITING, ScanQueue, StampGuard
from somfusion_ros.slam.session import Session


class Counts(Counter):
    """Counts faults as the nodes do."""

    def __call__(self, kind: str, reason: str = '') -> None:
        """Count one."""
        self[kind] += 1


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
    queue.add(1.2, 'late', now=10.0)
    assert not list(queue.ready(11.0))
    assert not counts
    assert not list(queue.ready(11.01))
    assert counts['scans_without_odometry'] == 1
    assert len(queue) == 0


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
    assert counts['scans_too_many'] == 50


def test_one_stray_stamp_is_no_jump() -> None:
    guard = StampGuard()
    assert [guard.check(s) for s in (1.0, 1.1, 9e9, 1.2, -5.0, 1.3, 0.0)] == [
        'good', 'good', 'stray', 'good', 'stray', 'good', 'stray']


@pytest.mark.parametrize(('start', 'word'), [(3.0, 'jumped_back'), (1e6, 'jumped_ahead')])
def test_several_strange_stamps_that_follow_one_another_are_a_jump(start: float,
                                                                   word: str) -> None:
    guard = StampGuard()
    guard.check(100.0)
    words = [guard.check(start + 0.1 * i) for i in range(JUMP_CONFIRMED + 3)]
    assert words == ['stray'] * (JUMP_CONFIRMED - 1) + [word] + ['good'] * 3


def test_strange_stamps_without_order_are_never_a_jump() -> None:
    guard = StampGuard()
    guard.check(100.0)
    assert {guard.check(s) for s in (50.0, 40.0, 30.0, 20.0, 10.0, 5.0, 4.0, 3.0)} == {'stray'}


def test_a_wrong_first_stamp_is_overcome() -> None:
    guard = StampGuard()
    guard.check(9e9)
    words = [guard.check(1.0 + 0.1 * i) for i in range(JUMP_CONFIRMED + 1)]
    assert words[-1] == 'good'


class Drive:
    """A drive through a room, fed to a session as a robot would."""

    def __init__(self) -> None:
        self.counts = Counts()
        self.session = Session(SlamConfig(), 0.5, self.counts)
        way = np.array([[1.5, 1.5], [3.5, 1.5], [6.5, 1.0], [6.5, 2.8], [4.5, 3.0], [2.0, 3.0]])
        self.stamps, self.poses = fake_trajectory(way)
        self.odometry = fake_odometry(self.poses)
        self.steps: list = []

    def feed(self, first: int, last: int, shift: float = 0.0,
             T_odom_odom: Pose | None = None) -> None:
        """Feed a part of the drive, at shifted stamps."""
        for i in range(first, last):
            stamp = self.stamps[i] + shift
            pose = self.odometry[i] if T_odom_odom is None else compose(T_odom_odom,
                                                                        self.odometry[i])
            scan = fake_scan(fake_room(), self.poses[i], stamp, beams=181)
            self.session.add_odometry(stamp, pose)
            self.session.add_scan(scan, i, 0.0)
            self.steps += list(self.session.steps(0.0))

    def error(self) -> float:
        """Distance [m] of the last step from the truth, both from the first step."""
        (first, one), (last, other) = self.steps[0], self.steps[-1]
        return pose_error(between(one.pose, other.pose),
                          between(self.poses[first], self.poses[last]))[0]


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
    assert len(drive.session.slam.trajectory()[0]) < 40


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


def test_a_worker_does_jobs_in_order_and_survives_a_failing_one() -> None:
    done, errors, finished = [], [], threading.Event()
    worker = Worker(lambda: False, errors.append, period=0.01)
    worker.start()
    worker.submit(lambda: done.append(1))
    worker.submit(lambda: 1 / 0)
    worker.submit(lambda: done.append(2))
    worker.submit(finished.set)
    assert finished.wait(5.0)
    assert done == [1, 2]
    assert isinstance(errors[0], ZeroDivisionError)
    assert worker.close(5.0)


def test_a_worker_goes_on_while_there_is_more_and_takes_jobs_in_between() -> None:
    left, asked = [5], threading.Event()

    def idle() -> bool:
        left[0] -= 1
        return left[0] > 0
    worker = Worker(idle, lambda error: None, period=60.0)
    worker.submit(lambda: None)
    worker.start()
    worker.submit(asked.set)
    assert asked.wait(5.0)
    assert worker.close(5.0)
    assert left[0] <= 4


def test_a_worker_that_is_busy_says_so() -> None:
    busy, release = threading.Event(), threading.Event()

    def job() -> None:
        busy.set()
        release.wait(30.0)
    worker = Worker(lambda: False, lambda error: None)
    worker.start()
    worker.submit(job)
    assert busy.wait(5.0)
    assert not worker.close(0.05)
    release.set()
    assert worker.close(5.0)
