# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence for a hypothesis, and what the verdict makes of it."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from helpers import cut_grid, fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion import rasters, scoring
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.measures import Evidence, measure
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.fusion.rivals import rivals, slides
from somfusion_ros.fusion.verdict import judge, judge_by_V, Margins, probability
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid

GOOD = Evidence(matched=60.0, against=1.0, fine=50.0, fine_against=2.0, overlap=0.6, weak=10.0,
                weak_against=0.5, V=0.99, axis=np.array([1.0, 0.0]), solid=30.0, common=100.0)
BAD = Evidence(matched=20.0, against=19.0, fine=10.0, fine_against=15.0, overlap=0.3, weak=1.0,
               weak_against=4.0, V=0.95, axis=np.array([1.0, 0.0]), solid=10.0, solid_against=6.0,
               common=60.0)


@cache
def room(x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> LearnedMap:
    """Learn the room as seen from a frame in which its corner lies at (x, y, theta)."""
    return learn(fake_grid(fake_room(), 0.05, Pose(x, y, theta)))


@cache
def corridor() -> LearnedMap:
    """Two parallel walls without ends."""
    image = np.zeros((60, 400), np.float32)
    image[10:50] = 1.0
    image[[10, 49]] = -1.0
    image[:, :20] = image[:, -20:] = 0.0
    return learn(Grid(image, 0.05))


@settings(max_examples=10, deadline=None)
@given(st.floats(-3.1, 3.1))
def test_the_truth_agrees_in_everything(theta: float) -> None:
    """At the true pose nearly all wall is matched, nothing is missed, V is near 1."""
    found, = measure(np.array([[1.0, 2.0, theta]]), room(1.0, 2.0, theta), room())
    wall = room().clusters.weights.sum()
    assert found.matched > 0.9 * wall and found.ratio > 0.95
    assert found.weak_ratio > 0.85 and found.overlap > 0.95 and found.V > 0.98


def test_a_wrong_place_lowers_every_measure() -> None:
    """One metre off along x: walls stand where the other map saw free space."""
    good, bad = measure(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), room(), room())
    assert bad.ratio < 0.8 * good.ratio and bad.weak_ratio < 0.7 * good.weak_ratio
    assert bad.V < good.V and bad.score < 0.7 * good.score


def test_measures_do_not_depend_on_the_direction() -> None:
    """Exchanging the maps and inverting the pose gives the same evidence."""
    T = np.array([1.0, 2.0, 0.7]) + (0.1, -0.2, 0.02)
    forth, = measure(T[None], room(1.0, 2.0, 0.7), room())
    back, = measure(inverse(T)[None], room(), room(1.0, 2.0, 0.7))
    for name in ('matched', 'ratio', 'fine', 'fine_ratio', 'overlap', 'V'):
        assert getattr(forth, name) == pytest.approx(getattr(back, name), rel=1e-3), name
    assert forth.weak == pytest.approx(back.weak, rel=0.1)


def test_a_corridor_gives_no_evidence_along_itself() -> None:
    """All wall coincides, and yet nothing fixes the place along the corridor."""
    found, slid = measure(np.array([[0.0, 0, 0], [2.0, 0, 0]]), corridor(), corridor())
    assert found.ratio > 0.95 and slid.ratio > 0.9
    assert found.weak < 1.0 and abs(found.axis[0]) > 0.99


def test_walls_back_to_back_are_no_match() -> None:
    """Where no free space is common, walls that coincide do not rank; a foot before them does."""
    back, strip = replace(GOOD, common=0.0), replace(GOOD, common=0.3 * GOOD.fine)
    assert back.score == 0.0 < strip.score == GOOD.score


def test_cells_see_what_clusters_forgive() -> None:
    """Three cells beside the truth the clusters still agree, the cells do not."""
    good, near = measure(np.array([[0.0, 0.0, 0.0], [0.15, 0.15, 0.0]]), room(), room())
    assert near.matched > 0.8 * good.matched and near.fine < 0.4 * good.fine
    assert near.score < 0.3 * good.score < good.score


def test_likelihood_is_high_on_walls_and_low_on_specks() -> None:
    """A straight wall of one cell is bright, a single cell is not, two cells away it is dark."""
    wall = np.column_stack([np.arange(0.0, 3.0, 0.05) + 0.025, np.full(60, 1.025)])
    raster = rasters.likelihood(np.vstack([wall, [[1.525, 3.025]]]), 0.05)
    spots = np.array([[1.525, 1.025], [1.525, 1.075], [1.525, 1.225], [1.525, 3.025], [9.0, 9.0]])
    on, beside, off, speck, outside = raster.at(spots.T.astype(np.float32)) / 255.0
    assert on > 0.95 and 0.4 < beside < 0.8 and off < 0.05 and 0.2 < speck < 0.6
    assert outside == 0.0


def test_overlap_is_the_share_of_the_smaller_map() -> None:
    """Half a room lies wholly on the room: 1; two halves that share a third: about that."""
    grid = fake_grid(fake_room(9.0, 6.0))
    half = learn(cut_grid(grid, (-1, -1), (4.5, 7)))
    other = learn(cut_grid(grid, (3, -1), (10, 7)))
    whole, = measure(np.zeros((1, 3)), learn(grid), half)
    part, = measure(np.zeros((1, 3)), other, half)
    assert whole.overlap > 0.97
    assert part.overlap == pytest.approx(1 / 3, abs=0.08)


def test_scores_rank_like_the_evidence() -> None:
    """The cheap score of many hypotheses is that of the clusters' evidence, up to its thinning."""
    poses = np.array([[0, 0, 0], [0.3, 0, 0], [1.0, 0.5, 0.1], [3, 3, 3]], dtype=float)
    exact = [item.ratio * np.sqrt(item.matched) for item in measure(poses, room(), room())]
    assert scoring.scores(poses, room(), room()) == pytest.approx(exact, rel=1e-3)
    quick = scoring.scores(poses, room(), room(), every=2)
    assert np.argsort(quick).tolist() == np.argsort(exact).tolist()


def test_distinct_keeps_the_best_of_each_place() -> None:
    """Near duplicates go, best first, at most as many as wanted."""
    poses = np.array([[0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5, 0, 1.0], [9, 0, 0]], dtype=float)
    kept = scoring.distinct(poses, np.array([1.0, 3.0, 2.0, 2.5, 0.1]), np.zeros(2), 3)
    assert kept.tolist() == [[0.1, 0, 0], [5, 0, 1.0], [5, 0, 0]]


FOR = ('matched', 'fine', 'weak', 'overlap', 'common', 'passable')
AGAINST = ('against', 'fine_against', 'weak_against', 'solid_against')


@settings(max_examples=80, deadline=None)
@given(st.builds(Margins, *[st.floats(0.3, 5.0)] * 3), st.floats(0.0, 30.0), st.floats(0.0, 60.0),
       st.sampled_from(['margin', 'odds', 'weak_margin', *FOR, *AGAINST]))
def test_more_evidence_never_lowers_the_probability(
        margins: Margins, against: float, weak: float, changed: str) -> None:
    """The probability rises, or stays, with what speaks for a hypothesis, and falls with doubt."""
    item = replace(GOOD, against=against, fine_against=against, weak=weak,
                   solid_against=against / 3.0, passable=0.5)
    before = probability(item, margins)
    if hasattr(margins, changed):
        margins = replace(margins, **{changed: 1.2 * getattr(margins, changed)})
    else:     # of a better rival with more wall there would be more, too
        margins = Margins(*np.maximum(1.0, [margins.margin, margins.odds, margins.weak_margin]))
        before = probability(item, margins)
        factor = 1.2 if changed in FOR else 0.8
        item = replace(item, **{changed: factor * getattr(item, changed)})
    assert 0.0 <= before <= probability(item, margins) <= 1.0


def test_a_thin_strip_is_not_enough() -> None:
    """In 3 % of the smaller map walls that coincide to four fifths are refused, in 20 % not."""
    item, clear = replace(GOOD, weak=4.0, weak_against=0.4), Margins(3.0, 20.0, 4.0)
    doubtful = replace(item, overlap=0.03, common=15.0, fine=15.0, fine_against=4.0)
    assert probability(replace(item, overlap=0.2), clear) > 0.8
    assert probability(doubtful, clear) < 0.7      # 0.9 is asked


@pytest.mark.parametrize('mine, theirs, word', [
    (GOOD, BAD, 'accepted'), (GOOD, GOOD, 'ambiguous'), (BAD, BAD, 'refused')])
def test_verdicts_and_their_reasons(mine: Evidence, theirs: Evidence, word: str) -> None:
    """Good without a rival is accepted, with an equal rival ambiguous, bad is refused."""
    poses = np.array([[0, 0, 0], [3.0, 4.0, 0]], dtype=float)
    found = judge(poses, [mine, theirs], 0, np.array([1]), 0.8)
    assert found.reason.startswith(f'{word}: ') and found.accepted == (word == 'accepted')
    assert f'{100 * mine.ratio:.0f} %' in found.reason and '5.0 m' in found.reason
    assert found.probability + found.rival_probability <= 1.0 + 1e-9


def test_what_lies_beside_the_best_is_no_rival() -> None:
    """A duplicate within half a metre does not make the best ambiguous; the rest is ranked."""
    poses = np.array([[0, 0, 0], [0.3, 0.1, 0.01], [0, 0, 1.0], [5, 0, 0]])
    evidence = [GOOD, GOOD, BAD, replace(BAD, fine=40.0)]
    assert rivals(poses, evidence, 0, np.zeros(2)).tolist() == [3, 2]
    others = rivals(poses[:2], evidence[:2], 0, np.zeros(2))
    found = judge(poses, evidence, 0, others, 0.8)
    assert found.accepted and found.rival is None and found.reason.endswith('no rival')


def test_the_published_verdict_knows_only_V() -> None:
    """V against its threshold."""
    assert judge_by_V(replace(BAD, V=0.95), 0.9).accepted
    assert not judge_by_V(replace(GOOD, V=0.85), 0.9).accepted


def test_slides_run_along_the_weak_direction() -> None:
    """Both ways, without a turn."""
    beside = slides(np.array([1.0, 2.0, 0.3]), np.array([0.6, 0.8]))
    assert beside[:, 2] == pytest.approx(0.3)
    step = beside[:, :2] - (1.0, 2.0)
    assert step @ (-0.8, 0.6) == pytest.approx(0.0) and (step @ (0.6, 0.8)).min() < -3


@pytest.mark.parametrize('times', [5, 50, 500])
def test_a_map_is_not_refused_for_its_size(times: int) -> None:
    """The same shares of walls, on maps of up to 25 km of wall: as probable as on a small one."""
    clear = Margins(3.0, 20.0, 4.0)
    large = replace(GOOD, matched=times * 60.0, against=times * 2.0, fine=times * 50.0,
                    fine_against=times * 5.0, V=0.97, solid=times * 30.0, common=times * 100.0)
    assert probability(large, clear) > 0.9
    torn = replace(large, against=large.matched, fine_against=large.fine,
                   solid_against=large.solid / 4.0)
    assert probability(torn, clear) < 0.05


@pytest.mark.parametrize('theta', [0.0, 0.8])
def test_zones_tell_walls_their_surroundings_and_free_places(theta: float) -> None:
    """Of a square room, and of what lies outside and is not known; near is up to 0.2 m."""
    walls = np.array([(0, 0, 4, 0), (4, 0, 4, 4), (4, 4, 0, 4), (0, 4, 0, 0)], dtype=float)
    T = Pose(5.0, -3.0, theta)
    grid = fake_grid(walls, 0.05, T)
    raster = rasters.zones(grid, np.argwhere(grid.occupied), 0.1)
    x = (2.0, 3.6, 3.9, 4.03, 4.15, 4.6, 99.0)
    found = raster.at(np.array([compose(T, (at, 2.0, 0.0))[:2] for at in x], np.float32).T)
    assert (found & rasters.WALL > 0).tolist() == [False] * 3 + [True] + [False] * 3
    assert (found & rasters.NEAR > 0).tolist() == [False] * 2 + [True] * 3 + [False] * 2
    assert (found & rasters.FREE > 0).tolist() == [True] * 3 + [False] * 4
    free = rasters.free_places(raster, 100)
    assert 50 <= len(free) <= 220
    assert (raster.at(free.T.astype(np.float32)) & rasters.FREE > 0).all()


def test_rasters_too_wide_for_opencv_answer_alike() -> None:
    """The same corner of a raster of 40 and of 40 000 columns, inside and outside; exact."""
    rng = np.random.default_rng(5)
    values = rng.integers(0, 9, (50, 40000)).astype(np.uint8)
    points = rng.uniform(-2.0, 4.0, (2, 3, 100)).astype(np.float32)
    at = Pose(-1.0, 0.5, 0.3)
    wide, narrow = (Raster(values[:, :width], 0.1, at, 7) for width in (40000, 40))
    inside = np.hypot(points[0] + 1.0, points[1] - 0.5) < 3.9
    assert (wide.at(points) == narrow.at(points))[inside].all()
    assert (wide.at(points + 1e5) == 7).all()


@pytest.mark.parametrize('raster_of', [rasters.nearest, rasters.nearby])
def test_nearest_names_the_nearest_point(raster_of: Callable[..., Raster]) -> None:
    """Nearest of scattered points, up to the raster's cells; none beyond its reach."""
    rng = np.random.default_rng(4)
    points, asked = rng.uniform(0, 10, (60, 2)), rng.uniform(0, 10, (200, 2))
    raster = raster_of(points, 0.05, 1.0)
    named = raster.at(asked.T.astype(np.float32)).astype(int)
    distance = np.hypot(*(asked[:, None] - points[None]).transpose(2, 0, 1))
    near = distance.min(1) < (0.9 if raster_of is rasters.nearby else np.inf)
    assert 150 < near.sum()
    assert (distance[np.arange(200), named] < distance.min(1) + 0.11)[near].all()
    assert (named[distance.min(1) > 1.1] < 0).all() or raster_of is rasters.nearest
    assert raster.at(np.array([[99.0], [99.0]], np.float32))[0] == -1
