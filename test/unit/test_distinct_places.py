# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Distinct places along a direction: corners, doors, and walls that close a crossing."""

import numpy as np
import pytest
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.measures import Evidence, measure
from somfusion_ros.fusion.places import place_score, PLACES
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid


def corner(theta: float = 0.0) -> Grid:
    """Return two walls of eight metres that meet, and nothing else."""
    evidence = np.zeros((200, 200), np.float32)
    evidence[20:180, 20:180] = 1.0
    evidence[20, 20:180] = evidence[20:180, 20] = -1.0
    return Grid(evidence, 0.05, Pose(0.0, 0.0, theta))


def corridor(crossing: bool) -> Grid:
    """Return a corridor of 14 m, with a crossing of 3 x 2 m to one side or without."""
    evidence = np.zeros((160, 320), np.float32)
    evidence[20:60, 20:300] = 1.0
    evidence[[20, 59], 20:300] = -1.0
    if crossing:
        evidence[59:120, 140:200] = 1.0
        evidence[59:120, [140, 199]] = evidence[119, 140:200] = -1.0
    return Grid(evidence, 0.05, Pose())


def at_truth(target: Grid, source: Grid) -> Evidence:
    """Return the evidence for the maps as they lie."""
    found, = measure(np.zeros((1, 3)), learn(target), learn(source))
    return found


@pytest.mark.parametrize('theta', [0.0, 0.4, 0.785])
def test_a_corner_is_one_place_along_either_of_its_walls(theta: float) -> None:
    """However it lies: along a slanting direction its two walls would look like many places."""
    found = at_truth(corner(theta), corner(theta))
    assert found.matched > 14.0
    assert 0.5 * PLACES.place < found.weak < 1.5 * PLACES.place
    off = np.arctan2(found.axis[1], found.axis[0]) - theta
    assert np.cos(4.0 * off) == pytest.approx(1.0, abs=0.05)     # along one of the walls


def test_the_wall_that_closes_a_crossing_speaks_against_the_place() -> None:
    """It runs along the corridor, and yet it says that this is another place of it."""
    same, other = at_truth(corridor(True), corridor(True)), at_truth(
        corridor(True), corridor(False))
    assert same.weak_against < 0.1 and same.weak > 1.5
    assert other.weak_against > 0.5 and abs(other.axis[0]) > 0.99
    assert other.weak_score < 0.3 * same.weak_score


def test_a_place_counts_by_the_share_that_agrees() -> None:
    """More places for it raise the score, more against it lower it; without any it is zero."""
    held, lost = np.array([0.0, 1.0, 2.0, 2.0]), np.array([0.0, 0.0, 0.0, 1.0])
    none, one, two, doubted = place_score(held, lost)
    assert none == 0.0 and one < two and doubted < two
