# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and odometry whose clocks are set, stand still, run wrongly, or differ."""

from drives import Clock, Drive, right, tell_odometry, tell_scan, used
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session


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


@pytest.mark.parametrize('goes_on', [False, True])
@pytest.mark.parametrize('which', ['scans', 'odometry', 'both'])
def test_a_clock_that_stands_still_costs_at_most_one_view(which: str, goes_on: bool) -> None:
    """For 4 s, in which the robot drives 2 m; its messages are stamped by when they come."""
    def still(k: int) -> float:
        return -0.1 * min(max(0, k - 60), 40 if goes_on else (k < 100) * 40)

    drive = driven(right if which == 'odometry' else still, right if which == 'scans' else still)
    assert used(drive) >= len(drive.stamps) - 4
    assert drive.worst() < 0.1
    streams = ['scan', 'odometry'] if which == 'both' else [which.removesuffix('s')]
    assert all(drive.counts[f'{stream}_clock_stood'] == 1 for stream in streams)
    assert {'clocks_apart', 'scan_clock_set', 'lost'}.isdisjoint(drive.counts), drive.counts


@pytest.mark.parametrize('which', ['scans', 'odometry'])
@pytest.mark.parametrize('rate', [0.5, 0.9, 1.1])
def test_clocks_of_other_speeds_are_kept_together(rate: float, which: str) -> None:
    """Scans that are ahead wait until it is known, from where they are a second apart."""
    drift: Clock = lambda k: 0.1 * (rate - 1.0) * k
    drive = driven(*((drift, right) if which == 'scans' else (right, drift)))
    assert used(drive) >= len(drive.stamps) - 120
    ahead = (which == 'scans') == (rate > 1.0)
    assert drive.error() < (0.3 if ahead else 0.4), 'up to a second is 0.5 m'
    assert drive.counts['clocks_apart'] >= 1 if ahead else not drive.counts['clocks_apart']
    assert bool(drive.counts['scans_late']) == (not ahead and rate == 0.5), 'by more than 5 s'


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 119), st.floats(-1e4, 1e4)), max_size=4))
def test_whatever_the_stamps_the_robot_is_followed_in_the_end(stray: list) -> None:
    wrong = dict(stray)
    drive = driven(lambda k: wrong.get(k, 0.0))
    assert len(drive.steps) > len(drive.stamps) - 30
    assert drive.error() < 0.2
