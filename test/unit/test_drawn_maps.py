# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps that are changed and drawn for the benchmarks are what they are said to be."""

from benchmarks.data import drawings, renovations, worlds
from benchmarks.data.real_maps import cropped
from benchmarks.fusion import cases
from benchmarks.fusion.calibration import fresh_queue, queue
import numpy as np
import pytest
from somfusion_ros.geometry import apply
from somfusion_ros.grid import Grid


def room(side: int = 160) -> Grid:
    """Return a free room of 8 m with walls, in unknown surroundings."""
    evidence = np.zeros((side + 80, side + 60), np.float32)
    evidence[40:-40, 20:-40] = -1.0
    evidence[41:-41, 21:-41] = 1.0
    return Grid(evidence, 0.05)


def test_a_wall_in_the_middle_of_a_room_is_a_change() -> None:
    """Half of 6 m, for one of both maps has it; what stands 0.7 m from a wall is not counted."""
    before = room()
    evidence = before.evidence.copy()
    evidence[60:180, 100] = -1.0
    length, area = renovations.changed(before, Grid(evidence, 0.05))
    assert length == pytest.approx(3.0, abs=0.1)
    assert area == pytest.approx(63.0, abs=1.0)
    evidence = before.evidence.copy()
    evidence[60:180, 30] = -1.0
    assert renovations.changed(before, Grid(evidence, 0.05))[0] == 0.0


def test_a_cropped_map_shows_the_same_in_the_same_places() -> None:
    grid = worlds.turned(room(), np.random.default_rng(1))
    small = cropped(grid)
    assert np.prod(small.shape) < np.prod(grid.shape)
    assert small.points(small.occupied) == pytest.approx(grid.points(grid.occupied), abs=1e-9)


@pytest.mark.parametrize('degrees', [1.0, 9.0])
def test_a_bent_map_lies_where_the_function_of_the_bend_says(degrees: float) -> None:
    """Three quarters of the walls that are moved point by point hit a wall, to a cell."""
    grid = drawings.building(np.random.default_rng(3), 20.0, 12.0)
    bent, move = worlds.bend(grid, degrees, np.random.default_rng(4))
    moved = move(grid.points(grid.occupied))
    column, row = np.rint(moved / bent.resolution - 0.5).astype(int).T
    inside = (row > 0) & (column > 0) & (row < bent.shape[0] - 1) & (column < bent.shape[1] - 1)
    near = [bent.occupied[row[inside] + dy, column[inside] + dx]
            for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    assert np.any(near, axis=0).mean() > 0.75
    assert inside.mean() > 0.8


def test_drawn_storeys_differ() -> None:
    """Of the first that are drawn, some are left out: they are one storey, renovated."""
    found = [cases.make('storeys', None, number) for number in range(6)]
    assert any(case is not None for case in found)
    for case in found:
        assert case is None or case.truth is None


def test_a_true_case_is_true() -> None:
    """In an office that two robots saw, most walls of one lie on walls of the other."""
    case = cases.make('office', None, 7)
    at = apply(case.truth, case.source.points(case.source.occupied))
    column, row = (at / case.target.resolution).astype(int).T
    inside = (row > 1) & (column > 1) & (row < case.target.shape[0] - 2) & (
        column < case.target.shape[1] - 2)
    row, column = row[inside], column[inside]
    known = case.target.known[row, column]
    near = np.any([case.target.occupied[row + dy, column + dx]
                   for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0)
    assert near[known].mean() > 0.8


def test_the_real_cases_come_first_and_a_part_of_the_queue_has_all_kinds() -> None:
    wanted = queue(1.0, None)
    real = sum(cases.kinds()[kind][1] for kind in cases.REAL)
    assert {kind for kind, _ in wanted[:real]} == set(cases.REAL)
    learned = {kind for kind, (_, count) in cases.kinds().items() if count}
    assert {kind for kind, _ in wanted[:real + 300]} == learned
    assert len(set(wanted)) == len(wanted)
    true = ('corridor', 'office', 'building', 'parts')
    assert len(queue(0.1, list(true))) == pytest.approx(
        0.1 * sum(cases.kinds()[kind][1] for kind in true), abs=4)


def test_fresh_cases_are_in_no_table() -> None:
    """Of all kinds that are asked for, some of which nothing is learned from; none is learned."""
    wanted = fresh_queue(500)
    assert not set(wanted) & set(queue(1.0, None)) and len(set(wanted)) == len(wanted)
    assert 480 <= len(wanted) <= 500
    assert {'crossed', 'windows', 'hole'} <= {kind for kind, _ in wanted[:100]}


def test_a_window_and_what_lies_outside_are_the_whole_map() -> None:
    grid = room()
    inside, outside = worlds.window(grid, np.random.default_rng(2), 4.0)
    assert np.array_equal(inside.evidence + outside.evidence, grid.evidence)
    assert 0.0 < inside.free.sum() * 0.05 ** 2 <= 16.0 and outside.free.any()
