# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and odometry whose clocks are set, stand still, run wrongly, or differ."""

from collections.abc import Callable

from drives import Drive
from helpers import fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session

Clock = Callable[[int], float]


def right(k: int) -> float:
    """Be a clock that is right."""
    return 0.0


def driven(scan_clock: Clock = right, odometry_clock: Clock = right, restart: int = -1) -> Drive:
    """
    Drive with clocks that are off by a function of the number of the message.

    Before one of the messages, the SLAM may start again from its checkpoint.
    """
    drive = Drive()
    for i in range(len(drive.stamps)):
        if i == restart:
            drive.session = Session(SlamConfig(), 0.5, drive.counts,
                                    drive.session.slam.checkpoint(), background=False)
        tell_odometry(drive, i, odometry_clock)
        tell_scan(drive, i, scan_clock)
        drive.steps += list(drive.session.steps(drive.stamps[i]))
    return drive


def tell_odometry(drive: Drive, i: int, clock: Clock = right) -> None:
    """Tell a sample of the odometry."""
    drive.session.add_odometry(drive.stamps[i] + 1e5 + clock(i), drive.odometry[i])


def tell_scan(drive: Drive, i: int, clock: Clock = right, held: int = 0) -> None:
    """Tell a scan, which was held on its way while so many more were taken."""
    scan = fake_scan(fake_room(), drive.poses[i], drive.stamps[i] + 1e5 + clock(i), beams=181)
    drive.session.add_scan(scan, i, float(drive.stamps[i + held]))


def used(drive: Drive) -> int:
    """Return how many scans were used."""
    return len({tag for tag, step in drive.steps if step.accepted and step.reason != 'lost'})


def set_at(i: int, seconds: float) -> Clock:
    """Make a clock that is set by so many seconds at message i."""
    return lambda k: seconds * (k >= i)


@pytest.mark.parametrize('step', [-3600.0, -3.0, -2.4, -1.2, -0.5, 0.2, 1.2, 2.4, 100.0, 3600.0])
@pytest.mark.parametrize('which', ['both', 'scans', 'odometry', 'odometry a second later'])
def test_a_clock_that_is_set_while_driving_costs_at_most_one_view(step: float, which: str
                                                                  ) -> None:
    """At 0.5 m/s, ten scans a second; a view is kept every 0.4 m or 0.4 rad."""
    off = set_at(60, step)
    later = {'both': off, 'scans': right, 'odometry': off,
             'odometry a second later': set_at(70, step)}[which]
    drive = driven(right if which == 'odometry' else off, later)
    assert not drive.counts['maps_begun_anew']
    assert used(drive) >= len(drive.stamps) - 10, 'ten scans are 0.5 m'
    assert drive.worst() < 0.1


@pytest.mark.parametrize('off', [-1e9, -100.0, -1.0, 1.0, 100.0, 3000.0, 1e9])
@pytest.mark.parametrize('stream', ['scans', 'odometry'])
def test_one_stray_stamp_costs_one_message(off: float, stream: str) -> None:
    stray: Clock = lambda k: off * (k == 60)
    drive = driven(*((stray, right) if stream == 'scans' else (right, stray)))
    assert used(drive) >= len(drive.stamps) - 3
    assert drive.error() < 0.1
    named = sum(n for name, n in drive.counts.items() if 'stamps_' in name)
    assert named <= 2, dict(drive.counts)


@pytest.mark.parametrize('offset', [-1e9, -20.0, 1.3, 20.0, 1.7e9])
def test_scans_of_another_clock_are_paired_by_arrival(offset: float) -> None:
    drive = driven(lambda k: offset)
    assert drive.counts['scan_clock_differs'] == 1
    assert len(drive.steps) > len(drive.stamps) - 20
    assert drive.error() < 0.15


@pytest.mark.parametrize('step', [-5.0, 1.2, 5.0])
@pytest.mark.parametrize('restart', [-1, 60])
@pytest.mark.parametrize('which', ['scans', 'odometry'])
def test_a_clock_may_be_set_before_anything_is_known_of_it(step: float, restart: int, which: str
                                                           ) -> None:
    off = set_at(max(restart, 0) + 3, step)
    drive = driven(*((off, right) if which == 'scans' else (right, off)), restart)
    assert used(drive) >= len(drive.stamps) - 8
    assert drive.worst() < 0.1


@pytest.mark.parametrize('which', ['scans', 'odometry'])
def test_a_clock_that_stands_still_and_goes_on_costs_the_time_that_it_stood(which: str) -> None:
    """For 2.5 s, in which the robot drives 1.25 m; it has driven 0.3 m more when that is known."""
    still: Clock = lambda k: -0.1 * min(max(0, k - 60), 25)
    drive = driven(*((still, right) if which == 'scans' else (right, still)))
    assert used(drive) >= len(drive.stamps) - 25 - 8
    assert drive.worst() < 0.15
    assert drive.counts['clocks_apart'] == 1


@pytest.mark.parametrize('which', ['scans', 'odometry'])
@pytest.mark.parametrize('rate', [0.5, 0.9, 1.1])
def test_clocks_of_other_speeds_are_kept_together(rate: float, which: str) -> None:
    """From where they are 0.5 s apart, scans that are ahead wait in vain until that is known."""
    drift: Clock = lambda k: 0.1 * (rate - 1.0) * k
    drive = driven(*((drift, right) if which == 'scans' else (right, drift)))
    assert used(drive) >= len(drive.stamps) - 120
    ahead = (which == 'scans') == (rate > 1.0)
    assert drive.error() < (0.2 if ahead else 0.4), 'up to a second is 0.5 m'
    assert drive.counts['clocks_apart'] >= 1 if ahead else not drive.counts['clocks_apart']
    assert bool(drive.counts['scans_late']) == (not ahead and rate == 0.5), 'by more than 5 s'


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
    assert drive.counts['scans_without_odometry'] < 25
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


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 119), st.floats(-1e4, 1e4)), max_size=4))
def test_whatever_the_stamps_the_robot_is_followed_in_the_end(stray: list) -> None:
    wrong = dict(stray)
    drive = driven(lambda k: wrong.get(k, 0.0))
    assert len(drive.steps) > len(drive.stamps) - 30
    assert drive.error() < 0.2
