# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and odometry that come late, as a slow network or a busy computer makes them."""

from collections.abc import Callable

from drives import Clock, Drive, right, tell_odometry, tell_scan, used
import pytest


def late_all_the_time(k: int) -> int:
    """Be a slow network."""
    return 15


def late_at_first(k: int) -> int:
    """Be a network, or a computer, that is slow until 4.5 s."""
    return min(15, max(0, 45 - k))


def later_and_later(k: int) -> int:
    """Be a network that slows down, to 3 s."""
    return min(30, max(0, k - 40) // 2)


def driven_late(late: Callable[[int], int], scan_clock: Clock = right) -> Drive:
    """Drive with scans that come later, by a function of their number, than they were taken."""
    drive = Drive()
    for i in range(len(drive.stamps)):
        tell_odometry(drive, i)
        for k in range(i + 1):
            if k + late(k) == i:
                tell_scan(drive, k, scan_clock, held=i - k)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    return drive


@pytest.mark.parametrize('late', [late_all_the_time, late_at_first, later_and_later])
def test_scans_that_come_late_are_not_of_another_clock(late: Callable[[int], int]) -> None:
    """The odometry of their time is still there."""
    drive = driven_late(late)
    assert not drive.counts
    assert used(drive) >= len(drive.stamps) - 31
    assert drive.worst() < 0.1


def test_a_stamp_that_is_told_twice_does_not_make_late_scans_suspect() -> None:
    drive = driven_late(later_and_later, lambda k: -0.1 * (k == 20))
    assert drive.counts.keys() == {'scan_stamps_repeated'}
    assert used(drive) >= len(drive.stamps) - 32
    assert drive.worst() < 0.1


def test_scans_that_are_held_on_their_way_are_not_of_another_clock() -> None:
    drive = Drive()
    for i in range(len(drive.stamps)):
        tell_odometry(drive, i)
        if i == 90:
            for k in range(60, 90):
                tell_scan(drive, k, held=90 - k)
        if not 60 <= i < 90:
            tell_scan(drive, i)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    assert not drive.counts
    assert used(drive) >= len(drive.stamps) - 1
    assert drive.worst() < 0.1


@pytest.mark.parametrize('slower', [1, 2, 4])
def test_odometry_that_comes_late_is_waited_for(slower: int) -> None:
    """At once, or ever more, until it is 2.5 s late; then it catches up."""
    drive, odometry = Drive(), 0
    for i in range(len(drive.stamps)):
        late = min(25, max(0, i - 40) // slower) if slower > 1 else 25 * (i > 40)
        while odometry <= (i if i > 145 else i - late):
            tell_odometry(drive, odometry)
            odometry += 1
        tell_scan(drive, i)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
        if i == 140:
            assert drive.session.pairing.odometry_late == pytest.approx(2.5, abs=0.2)
    assert used(drive) >= len(drive.stamps) - 1
    assert drive.worst() < 0.1
    assert drive.counts == {'odometry_late': 1}
    assert drive.session.pairing.odometry_late == 0.0


def test_scans_do_not_wait_for_ever_for_odometry_that_stopped() -> None:
    drive = Drive()
    for i in range(len(drive.stamps)):
        if i < 40:
            tell_odometry(drive, i)
        tell_scan(drive, i)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    waiting = len(drive.stamps) - used(drive) - drive.counts['scans_without_odometry']
    assert waiting <= 61, 'for 6 s, at ten scans a second'
    assert drive.error() < 0.1


@pytest.mark.parametrize('what', ['lost', 'stamped on arrival'])
def test_scans_of_the_time_of_odometry_that_was_held_are_used(what: str) -> None:
    """For 2.5 s; all of it is lost, or comes at once, with one stamp."""
    drive = Drive()
    for i in range(len(drive.stamps)):
        for k in range(40, 65):
            if i == 65 and what != 'lost':
                tell_odometry(drive, k, lambda k: drive.stamps[65] - drive.stamps[k])
        if not 40 <= i < 65:
            tell_odometry(drive, i)
        tell_scan(drive, i)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    assert used(drive) >= len(drive.stamps) - 1
    assert drive.counts['lost'] == 0
    assert drive.worst() < 0.1


def test_odometry_that_is_held_in_a_turn_is_not_believed_to_have_gone_straight_on() -> None:
    """For 2.5 s, as a scan is expected to where the odometry had been before it was held."""
    drive = Drive()
    for i in range(len(drive.stamps)):
        if i == 125:
            for k in range(100, 125):
                tell_odometry(drive, k)
        if not 100 <= i < 125:
            tell_odometry(drive, i)
        tell_scan(drive, i)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    assert not drive.counts['scans_without_odometry']
    assert drive.counts['lost'] == 0
    assert drive.worst() < 0.1


def test_of_scans_stamped_on_arrival_after_they_were_held_the_last_is_used() -> None:
    drive = Drive()
    for i in range(len(drive.stamps)):
        tell_odometry(drive, i)
        if not 60 <= i < 90:
            tell_scan(drive, i)
        if i == 90:
            for k in range(60, 90):
                tell_scan(drive, k, lambda k: drive.stamps[91] - drive.stamps[k], 90 - k)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    assert used(drive) >= len(drive.stamps) - 31
    assert all(name.startswith('scan_stamps') for name in drive.counts), drive.counts
    assert drive.worst() < 0.1
