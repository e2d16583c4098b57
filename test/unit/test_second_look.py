# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views that little holds are sought elsewhere in the map where they disagree with it."""

from benchmarks.slam.carried import carried, LASERS
import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose
from somfusion_ros.slam.checkpoint import Checkpoint, NOTHING
from somfusion_ros.slam.second_look import SecondLook
from somfusion_ros.slam.slam import Slam
from test_relocation import FIRST, run, trial

BACK = 20.0     # [m] driven, from which on the robot goes back where it came from


@pytest.fixture(scope='module')
def mapped() -> Checkpoint:
    """Drive along the corridor into a room, and back."""
    slam = Slam()
    run(slam, trial(FIRST[:7], 0.0, 4), np.zeros(3))
    return slam.checkpoint()


def looked(mapped: Checkpoint, first: int, last: int, moved: Array) -> bool:
    """Look again at views from one to another, moved by (3,) in the map."""
    poses = mapped.poses[:last].copy()
    poses[first:] = compose(moved, poses[first:])
    return SecondLook(poses, mapped.clouds[:last], mapped.scans, 0.05).elsewhere(first)


def first_on_the_way_back(mapped: Checkpoint) -> int:
    """Return the first view in the corridor after the first room."""
    way = np.cumsum(np.hypot(*np.diff(mapped.poses[:, :2], axis=0).T))
    return int(np.argmax(way > BACK)) + 1


def test_views_at_their_place_stay(mapped: Checkpoint) -> None:
    first = first_on_the_way_back(mapped)
    assert not looked(mapped, first, first + 12, np.zeros(3))


@pytest.mark.parametrize('along', [-4.3, -7.0, 3.0])
def test_views_at_another_place_of_a_corridor_are_found_out(along: float, mapped: Checkpoint
                                                            ) -> None:
    first = first_on_the_way_back(mapped)
    assert looked(mapped, first, first + 12, np.array([along, 0.0, 0.0]))


def test_views_of_what_the_map_does_not_show_stay(mapped: Checkpoint) -> None:
    """The room was not seen before; it is not sought where it agrees with all that was."""
    first = int(np.argmax(mapped.poses[:, 1] > 0.8))
    assert not looked(mapped, first, first + 12, np.zeros(3))


@pytest.mark.filterwarnings('error')
def test_views_that_see_nothing_are_not_judged(mapped: Checkpoint) -> None:
    """As where all of them were taken back: a share of no points is no number."""
    n = len(mapped.poses)
    look = SecondLook(mapped.poses, n * [NOTHING], mapped.scans, 0.05)
    assert not look.elsewhere(n - 12)


def test_few_views_are_not_judged(mapped: Checkpoint) -> None:
    first = first_on_the_way_back(mapped)
    assert not looked(mapped, first, first + 4, np.array([3.0, 0.0, 0.0]))


def test_the_other_end_of_a_hall_that_is_nearly_the_same_turned_round_is_found_out() -> None:
    """All that it saw before is there again; of what it sees next, 4 % disagree."""
    assert not carried(8056, LASERS['180 deg, 12 m, 2.5 Hz']).unnoticed
