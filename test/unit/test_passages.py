# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what else a map shows can be reached from what both maps saw."""

from functools import partial

import numpy as np
import pytest
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.measures import Overlay
from somfusion_ros.fusion.passages import passable
from somfusion_ros.grid import Grid

HERE = np.zeros((1, 3))
HALL = 1.0, 9.0, 1.0, 7.0       # x0, x1, y0, y1 [m]
EAST, WEST = (9.1, 17.0, 1.0, 7.0), (-7.0, 0.9, 1.0, 7.0)
EAST_DOOR, WEST_DOOR = (8.9, 9.2, 3.0, 3.9), (0.8, 1.1, 4.0, 4.9)


def house(*rooms: tuple[float, ...], end: float = 20.0) -> LearnedMap:
    """Learn rectangles [m] of free space, with the walls around them, seen up to x = end."""
    free = np.zeros((160, 600), bool)
    for x0, x1, y0, y1 in rooms:
        free[round(20 * y0):round(20 * y1), round(20 * (x0 + 9.0)):round(20 * (x1 + 9.0))] = True
    grown = np.zeros_like(free)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            grown |= np.roll(free, (down, right), (0, 1))
    evidence = np.where(free, 1.0, np.where(grown, -1.0, 0.0)).astype(np.float32)
    evidence[:, round(20 * (end + 9.0)):] = 0.0
    return learn(Grid(evidence, 0.05))


def shares(one: LearnedMap, other: LearnedMap, pose: np.ndarray = HERE) -> tuple[float, float]:
    """Return what can be reached of one map, and of the other, placed by a pose (1, 3)."""
    lay = Overlay(pose, None)
    return passable(one, other, lay.back), passable(other, one, lay.forth)


def test_a_room_that_both_came_through_by_one_door_leads_on() -> None:
    """Two robots share a hall and its door; one saw the room behind."""
    whole, part = house(HALL, EAST, EAST_DOOR), house(HALL, EAST, EAST_DOOR, end=10.0)
    assert shares(whole, part) == (1.0, 1.0)


def test_a_room_that_happens_to_fit_leads_nowhere() -> None:
    """Each map goes on behind a door where the other has wall: only the hall can be reached."""
    one, other = house(HALL, EAST, EAST_DOOR), house(HALL, WEST, WEST_DOOR)
    assert shares(one, other) == pytest.approx((0.5, 0.5), abs=0.05)


def test_a_closed_door_cuts_off_what_lies_behind_only() -> None:
    """The other map shows one of two doors closed: half of what is elsewhere is reached."""
    one = house(HALL, EAST, EAST_DOOR, WEST, WEST_DOOR)
    part = house(HALL, EAST, EAST_DOOR, end=10.0)
    assert shares(one, part) == pytest.approx((0.67, 1.0), abs=0.04)


def test_a_door_that_is_off_by_drift_is_still_a_door() -> None:
    """A quarter of a metre beside the truth, both maps still hang together."""
    one, other = house(HALL, EAST, EAST_DOOR), house(HALL, EAST, EAST_DOOR, end=11.0)
    assert min(shares(one, other, np.array([[0.15, 0.2, 0.0]]))) > 0.95


def test_what_cannot_be_reached_anyway_is_not_asked_for() -> None:
    """What a map shows behind glass, without a way to it, is no contradiction."""
    assert shares(house(HALL, (9.6, 17.0, 1.0, 7.0)), house(HALL)) == (1.0, 1.0)


def test_maps_without_free_space_in_common_do_not_count() -> None:
    far = partial(shares, house(HALL), house(HALL), np.array([[0.0, 30.0, 0.0]]))
    assert far() == (1.0, 1.0)
