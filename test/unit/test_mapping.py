# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps: walls and free space where they are, and new poses redraw them."""

from collections import Counter
from dataclasses import replace
from unittest.mock import patch

from helpers import fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.mapping import Mapper
from somfusion_ros.slam.scan import cloud

ROOM = fake_room()
PLACES = np.array([(1.5, 1.5, 0.3), (2.5, 1.2, -0.4), (2.0, 2.5, 1.0), (5.0, 4.0, 2.0)])


def scans(repeat: int = 4) -> list[MapScan]:
    return [MapScan(k, np.zeros(3), cloud(fake_scan(ROOM, p), 30.0).outline)
            for _ in range(repeat) for k, p in enumerate(PLACES)]


def test_walls_lie_where_they_are():
    grid = Mapper(0.05).render(scans(), PLACES)
    walls = grid.points(grid.occupied)
    start, edge = ROOM[:, :2], ROOM[:, 2:] - ROOM[:, :2]
    share = ((walls[:, None] - start) * edge).sum(2) / (edge ** 2).sum(1)
    foot = start + np.clip(share, 0, 1)[:, :, None] * edge
    distance = np.hypot(*(walls[:, None] - foot).transpose(2, 0, 1)).min(1)
    assert len(walls) > 300 and np.percentile(distance, 99) < 0.05


def test_a_wall_seen_at_a_grazing_angle_is_not_wiped_out_by_the_beams_that_pass_it(rng):
    """A robot drives 5 m and looks down a corridor of 22 m, with a beam per degree, noise 1 cm."""
    walls = np.array([(-1, -1.2, 22, -1.2), (-1, 1.2, 8, 1.2), (10, 1.2, 22, 1.2),
                      (8, 1.2, 8, 3.0), (10, 1.2, 10, 3.0), (22, -1.2, 22, 1.2)])
    places = np.column_stack([np.arange(0.0, 5.0, 0.25), np.zeros(20),
                              rng.normal(0.0, 0.004, 20)])
    views = [fake_scan(walls, p, beams=240, range_max=30.0, noise=0.01, rng=rng) for p in places]
    straight = places * (1.0, 1.0, 0.0)   # the filter does not know the last 0.2 degrees
    grid = Mapper(0.05).render([MapScan(k, np.zeros(3), cloud(scan, 30.0).outline)
                                for k, scan in enumerate(views)], straight)
    points = grid.points(grid.occupied)
    seen = np.unique(np.floor(points[np.abs(points[:, 1] + 1.2) < 0.1, 0] / 0.25))
    assert ((seen >= 0) & (seen < 80)).sum() > 0.8 * 80   # of 20 m, in pieces of 0.25 m
    open_door = (points[:, 0] > 8.3) & (points[:, 0] < 9.7) & (np.abs(points[:, 1] - 1.2) < 0.1)
    assert not open_door.any()


def test_free_space_stays_inside():
    grid = Mapper(0.05).render(scans(), PLACES)
    free = grid.points(grid.free)
    assert 20.0 < len(free) * 0.05 ** 2 < 48.0
    assert free.min() > -0.06 and free[:, 0].max() < 8.06 and free[:, 1].max() < 6.06


def test_the_order_of_growing_does_not_matter():
    """Scans drawn one by one, or all at once, give the same cells at the same places."""
    every, step = scans(2), Mapper(0.05)
    for k in range(1, len(every) + 1):
        grown = step.render(every[:k], PLACES)
    once = Mapper(0.05).render(every, PLACES)
    for name in ('occupied', 'free'):
        np.testing.assert_allclose(
            np.sort(grown.points(getattr(grown, name)), axis=0),
            np.sort(once.points(getattr(once, name)), axis=0), atol=1e-9)


def test_moved_views_move_their_walls():
    mapper, shift = Mapper(0.05), np.array([1.0, 0.0, 0.0])
    every = scans()
    first = mapper.render(every, PLACES)
    second = mapper.render(every, PLACES + shift)
    for k in range(2):
        a, b = (np.percentile(g.points(g.free)[:, k], [0.1, 99.9]) for g in (first, second))
        np.testing.assert_allclose(b, a + shift[k], atol=0.06)


@given(st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_a_redraw_touches_what_moved_and_gives_the_map_drawn_anew(seed):
    """Two rooms, 60 m apart; some of the views of one move."""
    rng = np.random.default_rng(seed)
    every = [replace(scan, view=scan.view + room * len(PLACES))
             for room in range(2) for scan in scans(2)]
    views = np.concatenate([PLACES, PLACES + (60.0, 0.0, 0.0)])
    views += (0.012, 0.013, 0.0)      # no wall lies between two cells
    moving = rng.choice(len(PLACES), 2, replace=False)
    moved = views.copy()
    moved[moving] += rng.normal(0.0, (0.3, 0.3, 0.1), (2, 3))
    mapper = Mapper(0.05)
    mapper.render(every, views)
    with patch.object(Mapper, '_add', autospec=True, side_effect=Mapper._add) as add:
        again = mapper.render(every, moved)
    assert add.call_count <= len(every) // 2        # none of the other room
    anew = Mapper(0.05).render(every, moved)
    for name in ('occupied', 'free'):
        a, b = ({tuple(cell) for cell in np.rint(grid.points(getattr(grid, name)) / 0.025)}
                for grid in (again, anew))
        assert a == b


@given(st.integers(0, 1000))
@settings(max_examples=3, deadline=None)
def test_a_bounded_redraw_follows_the_poses_a_few_scans_at_a_time(seed: int) -> None:
    """After a loop moved all, those that moved farthest are drawn anew first."""
    rng, every, counters = np.random.default_rng(seed), scans(2), Counter[str]()
    moved = PLACES + rng.normal(0.0, (0.3, 0.3, 0.1), PLACES.shape)
    mapper = Mapper(0.05, counters)
    mapper.render(every, PLACES)
    behind = len(every)
    while behind:
        grid = mapper.render(every, moved, most=2)
        assert behind - 2 <= counters['map_scans_behind'] < behind
        behind = counters['map_scans_behind']
    np.testing.assert_array_equal(grid.evidence, mapper.render(every, moved).evidence)
    anew = Mapper(0.05).render(every, moved)
    for name in ('occupied', 'free'):
        a, b = ({tuple(cell) for cell in np.rint(one.points(getattr(one, name)) / 0.025)}
                for one in (grid, anew))
        assert len(a ^ b) < 0.001 * len(b)


def test_a_long_map_is_drawn_a_few_scans_at_a_time() -> None:
    """So that a node that goes on with it answers meanwhile."""
    every, counters = scans(2), Counter[str]()
    mapper, left = Mapper(0.05, counters), len(every)
    while left:
        grid = mapper.render(every, PLACES, most=5)
        assert counters['map_scans_undrawn'] == max(0, left - 5)
        left = counters['map_scans_undrawn']
    whole = Mapper(0.05).render(every, PLACES)
    assert grid.known.sum() == whole.known.sum()
    assert np.isclose(grid.evidence.sum(), whole.evidence.sum())


def test_a_bounded_redraw_keeps_together_what_it_draws() -> None:
    """A second room far away waits, though all of it moved nearly as far."""
    every = [replace(scan, view=scan.view + room * len(PLACES))
             for room in range(2) for scan in scans()]
    views = np.concatenate([PLACES, PLACES + (60.0, 0.0, 0.0)])
    moved = views + (0.2, 0.0, 0.0)
    moved[0, 0] += 0.01
    mapper = Mapper(0.05)
    mapper.render(every, views)
    with patch.object(Mapper, '_add', autospec=True, side_effect=Mapper._add) as add:
        mapper.render(every, moved, most=len(every) // 2)
    assert add.call_count == len(every) // 2


def test_an_empty_map_is_one_unknown_cell():
    grid = Mapper(0.05).render([], np.zeros((0, 3)))
    assert grid.shape == (1, 1) and not grid.known.any()


def test_a_scan_far_away_is_left_out_and_counted() -> None:
    """An odometry that jumped by kilometres ends neither the map nor the memory."""
    counters: Counter[str] = Counter()
    mapper = Mapper(0.05, counters)
    whole = mapper.render(scans(), PLACES)
    far = [*scans(), MapScan(len(PLACES), np.zeros(3), scans()[0].outline)]
    for away in ((3e5, 4e5, 0.0), (1e12, 0.0, 0.0)):
        grid = Mapper(0.05, counters).render(far, np.vstack([PLACES, away]))
        np.testing.assert_array_equal(grid.evidence, whole.evidence)
        assert counters['map_scans_too_far'] == 1


def test_a_scan_far_away_may_move_and_come_back() -> None:
    """Where only scans moved that were left out, nothing was left to draw: it was an error."""
    counters: Counter[str] = Counter()
    mapper, far = Mapper(0.05, counters), len(PLACES)
    every = [*scans(), MapScan(far, np.zeros(3), scans()[0].outline)]
    for away, too_far in (3e5, 1), (4e5, 1), (2.0, 0):
        grid = mapper.render(every, np.vstack([PLACES, (away, 1.0, 0.0)]))
        assert counters['map_scans_too_far'] == too_far
    anew = Mapper(0.05).render(every, np.vstack([PLACES, (2.0, 1.0, 0.0)]))
    assert grid.known.sum() == anew.known.sum()


def test_a_first_scan_that_is_too_large_leaves_room_for_the_others() -> None:
    every = scans()
    large = replace(every[0], outline=Outline(
        300.0 * every[0].outline.ends, 300.0 * every[0].outline.reach, every[0].outline.hit))
    np.testing.assert_array_equal(Mapper(0.05).render([large, *every], PLACES).evidence,
                                  Mapper(0.05).render(every, PLACES).evidence)
