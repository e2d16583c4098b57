# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole way from two maps to a verdict."""

import csv

from helpers import cut_grid, fake_grid, fake_room, need_data, pose_error
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import align, Alignment, trace
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import between, compose, inverse, Pose
from somfusion_ros.grid import Grid

HERE = Pose()


def floor(width: float = 18.0, height: float = 11.0) -> np.ndarray:
    """Walls (N, 4) of a hall with cabins of different width along both long sides."""
    walls = [(0, 0, width, 0), (width, 0, width, height), (width, height, 0, height),
             (0, height, 0, 0)]
    for y, back, shares in ((3.2, 0.0, (0.11, 0.19, 0.15, 0.22, 0.13, 0.2)),
                            (7.6, height, (0.2, 0.12, 0.25, 0.1, 0.18, 0.15))):
        ends = width * np.cumsum((0,) + shares)
        for x0, x1 in zip(ends, ends[1:], strict=False):
            door = x0 + 0.3 * (x1 - x0)
            walls += [(x0, y, door, y), (door + 0.9, y, x1, y), (x1, back, x1, y)]
    return np.array(walls[:-1], dtype=float)


def error_at(found: Alignment, truth: np.ndarray,
             spot: tuple[float, float]) -> tuple[float, float]:
    """Distance [m] at a spot of the source map, and angle [rad], from the truth."""
    return pose_error(compose(found.T_target_source, (*spot, 0.0)), compose(truth, (*spot, 0.0)))


def noisy(grid: Grid, seed: int, lost: float = 0.15, added: float = 0.002) -> Grid:
    """Forget some wall cells and put specks on free ones."""
    rng = np.random.default_rng(seed)
    evidence, chance = grid.evidence.copy(), rng.random(grid.shape)
    evidence[grid.occupied & (chance < lost)] = 0.0
    evidence[grid.free & (chance < added)] = -0.7
    return Grid(evidence, grid.resolution, grid.T_frame_grid)


def corridor(seed: int, length: float, width: float = 2.0) -> Grid:
    """Draw a corridor without ends, with recessed doors at random places."""
    rng, r = np.random.default_rng(seed), 0.05
    free = np.zeros((int((width + 3) / r), int(length / r)), np.uint8)
    low, high = int(1.5 / r), int((1.5 + width) / r)
    free[low:high] = 1
    for start in np.cumsum(rng.uniform(2.0, 6.0, 100)):
        door = slice(int(start / r), int((start + 0.9) / r))
        free[(slice(low - 3, low), slice(high, high + 3))[rng.integers(2)], door] = 1
    wall = np.zeros(free.shape, bool)
    wall[1:] |= (free[:-1] == 1) & (free[1:] == 0)
    wall[:-1] |= (free[1:] == 1) & (free[:-1] == 0)
    wall[:, 1:] |= (free[:, :-1] == 1) & (free[:, 1:] == 0)
    wall[:, :-1] |= (free[:, 1:] == 1) & (free[:, :-1] == 0)
    return Grid(np.where(wall, -1.0, free).astype(np.float32), r)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(theta=st.floats(-3.1, 3.1), x=st.floats(-30, 30), size=st.sampled_from([8.0, 14.0, 25.0]),
       resolutions=st.tuples(*[st.sampled_from([0.03, 0.05, 0.1])] * 2), seed=st.integers(0, 99))
def test_finds_any_turn_shift_size_and_resolution(
        theta: float, x: float, size: float, resolutions: tuple[float, float],
        seed: int) -> None:
    """A room seen twice, with noise and mixed resolutions: right within half a cell, 0.5 deg."""
    room, T = fake_room(size, 0.7 * size), Pose(x, -5.0, theta)
    target = noisy(fake_grid(room, resolutions[0], T), seed)
    found = align(target, noisy(fake_grid(room, resolutions[1]), seed + 1))
    # Both maps draw their walls up to a cell off: half a cell of each may remain.
    distance, angle = error_at(found, T, (0.5 * size, 0.3 * size))
    assert found.accepted, found.reason
    assert distance < 0.75 * max(resolutions) and angle < np.radians(0.5)


@settings(max_examples=8, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(0.75, 0.9))
@example(0.5, 0.754)
def test_finds_a_partial_overlap(theta: float, share: float) -> None:
    """Two robots saw the left and the right part of one floor."""
    T = Pose(4.0, 1.0, theta)
    left = cut_grid(fake_grid(floor()), (-1, -1), (18.0 * share, 12))
    right = cut_grid(fake_grid(floor()), (18.0 * (1 - share), -1), (19, 12))
    placed = Grid(left.evidence, left.resolution,
                  Pose.from_array(compose(T, left.T_frame_grid)))
    found = align(placed, right)
    assert found.accepted, found.reason
    distance, angle = error_at(found, T, (8.0, 5.0))
    assert distance < 0.02 and angle < np.radians(0.3) and found.overlap < 1.0


def test_both_directions_give_the_same_answer() -> None:
    """Exchanging the maps inverts the pose and changes no verdict."""
    a = noisy(fake_grid(fake_room(10, 7), 0.05, Pose(1.0, 2.0, 2.0)), 1)
    b = cut_grid(noisy(fake_grid(fake_room(10, 7)), 2), (2, -1), (11, 8))
    forth, back = align(a, b), align(b, a)
    assert forth.T_target_source == pytest.approx(inverse(back.T_target_source), abs=1e-9)
    assert (forth.accepted, forth.probability) == (back.accepted, back.probability)
    spread = [np.sqrt(np.linalg.det(found.covariance)) for found in (forth, back)]
    assert spread[0] == pytest.approx(spread[1])


def test_the_same_input_gives_the_same_answer() -> None:
    """Fresh copies of the same maps give bit-equal answers, whatever rng is handed in."""
    answers = []
    for seed in (0, 1):
        maps = [noisy(fake_grid(fake_room(), 0.05, Pose(0, 0, t)), 3) for t in (0.0, 1.0)]
        answers.append(align(*maps, rng=np.random.default_rng(seed)))
    assert answers[0].T_target_source == answers[1].T_target_source
    assert answers[0].probability == answers[1].probability
    assert answers[0].reason == answers[1].reason


@pytest.mark.parametrize('shape', [(1, 1), (3, 200), (20, 20), (300, 300)])
@pytest.mark.parametrize('value', [0.0, 1.0, -1.0])
def test_maps_without_structure_are_refused_with_a_reason(shape: tuple[int, int],
                                                          value: float) -> None:
    """Unknown, free or solid everywhere, of any size: no match is a value, not an error."""
    blank = Grid(np.full(shape, value, np.float32), 0.05)
    for pair in ((blank, fake_grid(fake_room())), (blank, blank)):
        found = align(*pair)
        assert not found.accepted and found.probability < 0.5
        assert found.reason.startswith('refused: ')


@settings(max_examples=8, deadline=None)
@given(st.floats(-3.1, 3.1), st.sampled_from(['outside', 'rooms']))
def test_filled_areas_are_not_walls_all_through(theta: float, where: str) -> None:
    """People fill what a robot must not enter, or all that is outside; lasers see surfaces."""
    T, margin = Pose(1.5, -0.7, theta), 6.0
    target = fake_grid(floor(), T_map_walls=T, margin=margin)
    drawn = target.evidence.copy()
    if where == 'outside':
        drawn[drawn == 0.0] = -1.0
    else:
        left, low, right, high = (int((edge + margin) / target.resolution)
                                  for edge in (0.0, 0.0, 9.36, 3.2))
        drawn[low:high, left:right] = -1.0
    found = align(Grid(drawn, target.resolution, target.T_frame_grid), fake_grid(floor()))
    assert found.accepted, found.reason
    distance, angle = error_at(found, T, (9.0, 5.5))
    assert distance < 0.1 and angle < np.radians(0.5)


def test_noise_is_refused() -> None:
    """Random cells hold no structure."""
    rng = np.random.default_rng(0)
    maps = [Grid(rng.choice([-1.0, 0.0, 1.0], (200, 200)).astype(np.float32), 0.05)
            for _ in range(2)]
    assert not align(*maps).accepted


def test_parts_without_overlap_are_refused() -> None:
    """The left and the right third of a floor share nothing."""
    floor = fake_grid(fake_room(24, 10))
    found = align(cut_grid(floor, (-1, -1), (8, 11)), cut_grid(floor, (16, -1), (25, 11)))
    assert not found.accepted


def test_a_symmetric_floor_is_ambiguous_and_names_the_rival() -> None:
    """A floor of two equal halves fits itself turned by 180 degrees just as well."""
    turned = (18.0, 11.0, 18.0, 11.0) - floor()
    walls = np.vstack([floor()[:4], floor()[4:21], turned[4:21]])
    found = align(fake_grid(walls), fake_grid(walls, 0.05, Pose(2.0, 1.0, 0.4)))
    assert not found.accepted and found.reason.startswith('ambiguous: '), found.reason
    _, turn = pose_error(found.runner_up.T_target_source, found.T_target_source)
    assert abs(turn - np.pi) < 0.1


@pytest.mark.parametrize('seed', range(6))
def test_a_corridor_in_another_corridor_is_not_accepted(seed: int) -> None:
    """Two parallel walls fit every corridor of the same width; doors elsewhere say no."""
    assert not align(corridor(seed, 30.0), corridor(seed + 100, 20.0 + seed)).accepted


def test_a_mirrored_map_is_not_accepted() -> None:
    """The mirror image of a floor is another floor."""
    floor = fake_grid(fake_room(16, 10))
    assert not align(floor, Grid(floor.evidence[:, ::-1], 0.05)).accepted


def test_the_published_method_stays_selectable() -> None:
    """Method `paper` decides by V alone and finds an easy pair."""
    config = FusionConfig(method='paper')
    target = fake_grid(fake_room(), 0.05, Pose(0.1, 0.0, 0.05))
    found = align(target, fake_grid(fake_room()), config)
    assert 'V is' in found.reason and found.runner_up is None
    assert error_at(found, (0.1, 0.0, 0.05), (4, 3))[0] < 0.3


def test_an_unknown_method_is_wrong_use() -> None:
    """A method that does not exist is refused by name."""
    with pytest.raises(ValueError, match="method = 'sum' must be one of som, paper"):
        FusionConfig(method='sum')


def test_nothing_is_learned_twice() -> None:
    """The same Grid object keeps its clusters; another config learns anew."""
    grid, cache = fake_grid(fake_room()), FusionCache()
    first = learn(grid, cache=cache)
    assert learn(grid, cache=cache) is first
    wider = learn(grid, FusionConfig(cluster_spacing=0.8), cache)
    assert len(wider.features) < len(first.features)


def test_trace_shows_what_was_learned() -> None:
    """The trace belongs to the alignment and holds every cell once."""
    a, b = fake_grid(fake_room(), 0.05, Pose(0, 0, 1.0)), fake_grid(fake_room())
    shown = trace(a, b)
    assert shown.alignment.T_target_source == align(a, b).T_target_source
    assert shown.correlation.shape == (360,)
    for part, grid in ((shown.target, a), (shown.source, b)):
        assert sum(map(len, part.segments)) == grid.occupied.sum()
        assert part.clusters.shape == part.normals.shape and part.histogram.shape == (360,)
        assert part.radon.shape[0] == len(part.radon_directions) == len(part.radon_sharpness)
    assert shown.alignment.performance_index[-1] <= shown.alignment.performance_index[0]


def test_real_pairs() -> None:
    """Some real pairs: the true ones are right within 0.1 m, no other is accepted."""
    folder = need_data('pairs')
    with open(folder / 'manifest.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    for row in rows[::9]:
        pair = np.load(folder / f'{row["name"]}.npz')
        target, source = (Grid.from_occupancy(pair[side], float(pair['resolution']),
                                              (*pair[f'{side}_origin'], 0.0))
                          for side in ('target', 'source'))
        found = align(target, source)
        if row['kind'] != 'pos':
            assert not found.accepted, row['name']
            continue
        truth = [float(row[name]) for name in ('x', 'y', 'theta')]
        centre = float(row['centre_x']), float(row['centre_y'])
        distance, angle = error_at(found, truth, centre)
        assert found.accepted, f'{row["name"]}: {found.reason}'
        assert distance < 0.1 and angle < np.radians(0.5), row['name']


def test_covariance_follows_the_pose_into_the_other_frame() -> None:
    """Exchanged maps: the covariance is that of the inverted pose."""
    a = fake_grid(fake_room(), 0.05, Pose(3.0, -1.0, 1.2))
    b = cut_grid(fake_grid(fake_room()), (-1, -1), (6, 7))
    forth, back = align(a, b), align(b, a)
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(3), forth.covariance, 20000)
    turned = inverse(np.asarray(forth.T_target_source) + draws)
    spread = np.cov((turned - np.asarray(back.T_target_source)).T)
    assert np.sqrt(np.diag(spread)) == pytest.approx(np.sqrt(np.diag(back.covariance)), rel=0.05)
    assert pose_error(between(back.T_target_source, inverse(forth.T_target_source)),
                      HERE)[0] < 1e-9
