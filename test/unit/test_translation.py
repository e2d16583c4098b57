# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Seeds by voting, Algorithm 2, bending, and the refinement, on a room with known truth."""

from functools import cache

from helpers import fake_grid, fake_room, pose_error
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion import deformation, rasters, refinement, translation, voting
from somfusion_ros.fusion.cluster_matching import match
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import apply, compose, inverse, place, Pose, rotation
from somfusion_ros.grid import Grid

QUARTER = np.pi / 2


@cache
def learned(x: float = 0.0, y: float = 0.0, theta: float = 0.0,
            resolution: float = 0.05) -> LearnedMap:
    """Learn the room as seen from a frame in which its corner lies at (x, y, theta)."""
    return learn(fake_grid(fake_room(), resolution, Pose(x, y, theta)))


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-20, 20), st.floats(-20, 20))
def test_the_right_shift_gets_the_most_votes(theta: float, x: float, y: float) -> None:
    """With the turn known modulo 90 degrees, the best seed of its quarter is within a bin."""
    target, source = learned(x, y, theta), learned()
    votes = voting.VoteGrid(target.features, source.features, 0.5, 512)
    found = votes.seeds(theta % QUARTER, 5)
    assert found.shape == (4, 5, 3)
    best = found[int(np.round((theta - theta % QUARTER) / QUARTER)) % 4, 0]
    distance, angle = pose_error(compose(best, (4.0, 3.0, 0.0)),
                                 compose((x, y, theta), (4.0, 3.0, 0.0)))
    assert distance < 0.75 and angle < 1e-6


def test_quarter_turns_of_the_spectrum_are_turns_of_the_clusters() -> None:
    """The re-indexed spectrum equals the spectrum of the turned clusters."""
    room = learned()
    votes = voting.VoteGrid(room.features, room.features, 0.5, 512)
    centred = room.features.centres - votes.centre_source
    R = rotation(QUARTER)
    quick = voting._quarter_turn(votes._draw(room.features, centred, room.features.normals))
    slow = votes._draw(room.features, centred @ R.T, room.features.normals @ R.T)
    # Doubled angles: a quarter turn changes the sign of every normal's number.
    alike = np.vdot(quick, -slow) / np.linalg.norm(quick) / np.linalg.norm(slow)
    assert alike.real > 0.999


def test_a_huge_map_gets_coarser_bins() -> None:
    """The voting grid never has more than the wanted number of cells along an edge."""
    room = learned().features
    far = room.take(np.arange(len(room)))
    object.__setattr__(far, 'centres', room.centres * 100.0)
    votes = voting.VoteGrid(far, room, 0.5, 128)
    assert votes.size <= 140 and votes.bin > 5.0


def test_placing_is_the_pose_of_geometry() -> None:
    """Batched placing equals geometry.apply for each pose, to single precision."""
    rng = np.random.default_rng(0)
    poses, points = rng.uniform(-3, 3, (4, 3)), rng.uniform(-20, 20, (7, 2))
    for pose, placed in zip(poses, place(poses, points).transpose(1, 2, 0), strict=True):
        assert placed == pytest.approx(apply(pose, points), abs=1e-5)


def test_matches_need_place_and_normal() -> None:
    """A room matches itself; turned by 40 degrees nothing matches within 25."""
    room = learned()
    same = match(np.zeros((1, 3)), room.features, room.features, room.nearest, 0.4, 0.5)
    assert same.agrees.mean() > 0.9
    middle = np.array([4.0, 3.0])
    turn = np.r_[middle - rotation(0.7) @ middle, 0.7]
    other = match(turn[None], room.features, room.features, room.nearest, np.radians(25), 0.5)
    assert other.agrees.mean() < 0.1


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.05, 0.05))
def test_algorithm_2_settles(theta: float, dx: float, dy: float, turn: float) -> None:
    """From half a metre and 3 degrees off, every seed ends within 2 cm and 0.3 degrees."""
    target, source, truth = learned(2.0, -1.0, theta), learned(), np.array([2.0, -1.0, theta])
    middle = np.array([4.0, 3.0])
    start = truth + (dx, dy, turn)
    start[:2] += apply(truth, middle[None])[0] - apply(truth + (0, 0, turn), middle[None])[0]
    poses, J = translation.settle(start[None], source.features, target.features, target.nearest)
    distance, angle = pose_error(compose(poses[0], (4, 3, 0)), compose(truth, (4, 3, 0)))
    assert distance < 0.02 and angle < np.radians(0.3)
    assert J.shape == (len(translation.TRANSLATION.angles), 1) and J[-1, 0] < 0.02


def test_the_published_translation_converges_near_the_truth() -> None:
    """Mean shift with the true turn, 0.3 m off: J falls and the shift is found within 0.1 m."""
    target, source = learned(2.0, -1.0, 0.3), learned()
    nearest = rasters.nearest(target.features.centres, 0.2, 1.0)
    pose, J = translation.mean_shift((2.2, -1.2, 0.3), source.features, target.features, nearest)
    assert J[-1] < J[0]
    assert pose_error(pose, (2.0, -1.0, 0.3))[0] < 0.1


@pytest.mark.parametrize('resolution', [0.02, 0.05, 0.1])
@pytest.mark.parametrize('theta', [0.1, 0.3, -2.0])
def test_refinement_is_finer_than_a_cell(theta: float, resolution: float) -> None:
    """Maps drawn on different lattices: refined to a fifth of a cell and 0.1 degrees."""
    # No frame is along the walls: there, all cells of a wall are off by the same part of a cell.
    T_target_room, T_source_room = np.array([1.234, -0.777, theta]), np.array([0.3, 0.1, 0.6])
    target, source = (learn(redrawn(T, resolution)) for T in (T_target_room, T_source_room))
    truth = compose(T_target_room, inverse(T_source_room))
    pose, covariance = refinement.refine(truth + (0.08, -0.06, 0.01), target, source)
    distance, angle = pose_error(compose(pose, (2, 5, 0)), compose(truth, (2, 5, 0)))
    assert distance < 0.2 * resolution and angle < np.radians(0.1)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_covariance_is_large_where_no_wall_helps() -> None:
    """Two parallel walls fix the place across, and say nothing along."""
    image = np.zeros((60, 400), np.float32)
    image[10:50] = 1.0
    image[[10, 49]] = -1.0
    image[:, :20] = image[:, -20:] = 0.0
    corridor = learn(Grid(image, 0.05))
    _, covariance = refinement.refine(np.zeros(3), corridor, corridor)
    assert covariance[0, 0] > 100 * covariance[1, 1]


def test_bending_finds_the_bend_and_leaves_the_straight_alone() -> None:
    """A room bent by 0.3 m along 8 m is laid on the straight one; a straight one stays."""
    room = learned()
    clusters = room.features
    bent = clusters.take(np.arange(len(clusters)))
    bow = 0.3 * ((clusters.centres[:, 0] - 4.0) / 4.0) ** 2
    object.__setattr__(bent, 'centres', clusters.centres + np.column_stack([0 * bow, bow]))
    source = type(room)(**{**room.__dict__, 'features': bent})
    straight = (clusters.normals[:, 1] ** 2 > 0.9) & (clusters.straight > 0.9)
    for seen, most in ((source, 0.1), (room, 0.01)):
        warp = deformation.bend(np.zeros(3), room, seen).warp
        at = place(np.zeros((1, 3)), seen.features.centres)
        laid = (at + warp.at(at))[:, 0].T
        off = np.abs((laid - clusters.centres)[straight, 1])
        assert np.median(off) < most / 2 and np.percentile(off, 90) < most


def redrawn(T: np.ndarray, resolution: float) -> Grid:
    """Draw the room on an axis-aligned lattice of another frame, as a robot would have."""
    room = fake_room()
    ends = apply(T, room.reshape(-1, 2)).reshape(-1, 4)
    grid = fake_grid(ends, resolution)
    steps = [np.linspace(a, b, int(np.hypot(*(b - a)) / resolution * 20) + 2)
             for a, b in ends.reshape(-1, 2, 2)]
    evidence = np.where(grid.evidence < 0, 1.0, grid.evidence)
    row, column = grid.point_to_cell(np.concatenate(steps)).T
    evidence[row, column] = -1.0
    return Grid(evidence.astype(np.float32), resolution, grid.T_frame_grid)


def test_the_covariance_says_that_maps_are_bent() -> None:
    """A warp of a decimetre widens the covariance by about that; no warp leaves it."""
    room = learned()
    sharp = np.diag([1e-6, 1e-6, 1e-8])
    still, moved = (Warp(np.full((2, 2, 2), d, np.float32), np.zeros(2), 10.0) for d in (0, 0.1))
    moved.displacements[0] *= -1.0
    assert refinement.widen(sharp, np.zeros(3), room, still) == pytest.approx(sharp)
    wide = refinement.widen(sharp, np.zeros(3), room, moved)
    assert 0.02 < np.sqrt(np.linalg.eigvalsh(wide)[-1]) < 0.3
