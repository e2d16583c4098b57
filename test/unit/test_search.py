# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where no pose of the first search convinces, others are tried, and the right one is found."""

from benchmarks.fusion import cases
from helpers import fake_grid, pose_error
import numpy as np
import pytest
from somfusion_ros.fusion import orientation, voting
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import apply, Array, compose, Pose, rotation
from somfusion_ros.grid import Grid

OUTLINE = np.array([(0, 0), (30, 0), (30, 11), (24, 11), (24, 18), (9, 18), (9, 14), (0, 14)])
SHELF = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
FRAME = (3.0, -2.0, 1.3)
OFFICES = (115, 257, 426)     # drawn offices that were searched in vain before


def _ring(corners: Array) -> Array:
    """Join corners (N, 2) to walls (N, 4)."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def hall(seed: int, along: float, shelves: int = 180) -> Grid:
    """Draw a hall full of shelves, all along one direction [rad], which is not that of walls."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform((1.5, 1.5), (27.5, 9.0), (shelves, 2))
    sizes = rng.uniform((0.5, 0.4), (1.6, 0.9), (shelves, 2))
    return fake_grid(np.concatenate([_ring(OUTLINE.astype(float)), *(
        _ring(corner + SHELF * size @ rotation(along).T)
        for corner, size in zip(corners, sizes, strict=True))]))


@pytest.mark.parametrize('seed', [3, 4])
def test_a_hall_whose_shelves_were_turned_is_found(seed: int) -> None:
    """The histograms agree where the shelves are parallel; the walls are found all the same."""
    then, now = hall(seed, 0.4), hall(100 + seed, 1.1)
    turned = Grid(then.evidence, then.resolution,
                  Pose.from_array(compose(FRAME, then.T_frame_grid)))
    found = align(turned, now)
    distance, angle = pose_error(found.T_target_source, FRAME)
    assert found.accepted and distance < 0.3 and angle < np.radians(2.0)


@pytest.mark.parametrize('number', OFFICES)
def test_an_office_of_equal_rooms_is_found(number: int) -> None:
    """Its rooms lie on one another in many ways; the doors and desks tell, by finer votes."""
    case = cases.make('office', None, number)
    found = align(case.target, case.source)
    assert found.accepted and case.is_right(np.array(found.T_target_source))


@pytest.mark.parametrize('theta', [0.35, 2.2, -1.0])
def test_the_votes_of_any_turn_find_what_the_histograms_hide(theta: float) -> None:
    """Of all turns, the votes of the nearest stand out most, though the histograms name others."""
    then, now = (learn(hall(k, along)) for k, along in ((4, 0.4), (104, 1.1)))
    turned = now.features.take(np.arange(len(now.features)))
    object.__setattr__(turned, 'centres', apply((0.0, 0.0, -theta), turned.centres))
    object.__setattr__(turned, 'normals', turned.normals @ rotation(theta))
    step = np.pi / 2.0 / 20
    poses = voting.VoteGrid(then.features, turned, 1.0, 512).outstanding(
        step * np.arange(20), 60)
    middle = apply((0.0, 0.0, -theta), OUTLINE.mean(0)[None])[0]
    off = [pose_error(compose(pose, (*middle, 0.0)), compose((0.0, 0.0, theta), (*middle, 0.0)))
           for pose in poses[:3]]
    assert poses.shape == (60, 3)
    assert any(distance < 1.5 and angle <= step for distance, angle in off)
    hidden = orientation.families(orientation.peaks(
        orientation.correlate(then.histogram, now.histogram), 4))
    assert all(abs((turn + 0.2) % (np.pi / 2.0) - 0.2) > 0.1 for turn in hidden)
