# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fast segmentation is held to Algorithm 1 as published."""

import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from published_segmentation import grow
import pytest
from somfusion_ros.fusion.segmentation import segment

SHAPE = (40, 50)


def same_partition(a: np.ndarray, b: np.ndarray) -> bool:
    """Tell whether two labellings group the same items."""
    return len(set(zip(a, b, strict=True))) == len(set(a)) == len(set(b))


def draw(walls: list[tuple[int, int, int, int]], shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Cells (N, 2) as (row, column) of walls (x0, y0, x1, y1) drawn one cell wide."""
    image = np.zeros(shape, np.uint8)
    for x0, y0, x1, y1 in walls:
        cv2.line(image, (x0, y0), (x1, y1), 1)
    return np.argwhere(image)


def brute(cells: np.ndarray, radius: float) -> np.ndarray:
    """Label components of the graph that links cells at most `radius` apart, pair by pair."""
    near = np.hypot(*(cells[:, None] - cells[None]).transpose(2, 0, 1)) <= radius
    labels = np.arange(len(cells))
    while True:
        low = np.where(near, labels[None], len(cells)).min(1)
        if (low == labels).all():
            return labels
        labels = low


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10 ** 6), count=st.integers(1, 150),
       radius=st.sampled_from([1.0, 1.5, 2.0, 3.0, 4.3]))
def test_links_exactly_what_lies_within_the_radius(seed: int, count: int, radius: float) -> None:
    """Any set of cells: the segments are the components of the distance graph."""
    flat = np.random.default_rng(seed).choice(SHAPE[0] * SHAPE[1], count, replace=False)
    cells = np.column_stack(np.divmod(np.sort(flat), SHAPE[1]))
    assert same_partition(segment(cells, SHAPE, radius), brute(cells, radius))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10 ** 6), radius=st.sampled_from([2.0, 3.0, 5.0]))
def test_equals_the_published_algorithm_on_walls(seed: int, radius: float) -> None:
    """Walls without holes, at least two radii from one another: the same segments."""
    rng = np.random.default_rng(seed)
    band = int(2 * radius) + 6
    walls = [(int(rng.integers(0, 20)), y, int(rng.integers(25, 50)),
              y + int(rng.integers(0, 5))) for y in range(0, SHAPE[0] - 5, band)]
    cells = draw(walls)
    fast, published = segment(cells, SHAPE, radius), grow(cells, radius, radius)
    assert len(set(fast)) == len(walls)
    assert same_partition(fast, published)


def test_a_ring_of_width_delta_bridges_a_hole() -> None:
    """Where the ring of width 1 is empty, the wider ring keeps the segment going (3)."""
    cells = np.array([(0, c) for c in (0, 1, 3, 5)])
    assert len(set(grow(cells, 2.0, 2.0))) == 1
    assert len(set(segment(cells, (1, 6), 2.0))) == 1
    assert len(set(segment(cells, (1, 6), 1.0))) == 3


@pytest.mark.parametrize('count', [0, 1])
def test_few_cells(count: int) -> None:
    """No cell makes no segment, one cell makes one."""
    cells = np.zeros((count, 2), np.intp)
    assert len(segment(cells, (3, 3), 2.0)) == count == len(grow(cells, 2.0, 2.0))


def test_cells_at_opposite_edges_are_apart() -> None:
    """A row's end is no neighbour of the next row's start."""
    cells = np.array([(0, 9), (1, 0)])
    assert len(set(segment(cells, (2, 10), 3.0))) == 2
