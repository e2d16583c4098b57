# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nothing is learned twice: segments, maps, and verdicts on pairs."""

from helpers import fake_grid, fake_room
import numpy as np
import pytest
from somfusion_ros.fusion import segmentation, som
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.segment_cache import SegmentCache
from somfusion_ros.grid import Grid

SPACING = 0.4


def boxes(seed: int, count: int) -> tuple[np.ndarray, ...]:
    """Cells [m] of rectangles that do not touch, how often each is shown, and their segments."""
    rng, image = np.random.default_rng(seed), np.zeros((60 * count, 120), bool)
    for k in range(count):
        low, size = 60 * k + 10, rng.integers(20, 45, 2)
        image[[low, low + size[0]], 20:20 + size[1] + 1] = True
        image[low:low + size[0], [20, 20 + size[1]]] = True
    cells = np.argwhere(image)
    return ((cells[:, ::-1] + 0.5) * 0.05, rng.integers(1, 11, len(cells)).astype(float),
            segmentation.segment(cells, image.shape, 3.0))


def same(a: tuple[np.ndarray, ...], b: tuple[np.ndarray, ...]) -> bool:
    """Tell whether two results of the learning are equal to the last bit."""
    return all(np.array_equal(one, other) for one, other in zip(a, b, strict=True))


def test_only_changed_segments_are_learned_again() -> None:
    """One of five boxes changes: its cells alone are presented, the result is that of all."""
    memory, (points, times, segments) = SegmentCache(), boxes(0, 5)
    assert same(memory.train(points, times, segments, SPACING),
                som.train(points, times, segments, SPACING))
    assert memory.learned_cells == len(points)
    changed = segments == 2
    times = np.where(changed, 11.0 - times, times)
    assert same(memory.train(points, times, segments, SPACING),
                som.train(points, times, segments, SPACING))
    assert memory.learned_cells == len(points) + changed.sum()


def test_a_map_may_grow_around_what_is_known() -> None:
    """A new segment before the others gives them other numbers, and no more work."""
    memory, (points, times, segments) = SegmentCache(), boxes(1, 4)
    later = segments > 0
    memory.train(points[later], times[later], segments[later] - 1, SPACING)
    assert same(memory.train(points, times, segments, SPACING),
                som.train(points, times, segments, SPACING))
    assert memory.learned_cells == len(points)


@pytest.mark.parametrize('spacing', [0.2, 0.8])
def test_another_spacing_is_another_thing(spacing: float) -> None:
    """Clusters are remembered with the spacing they were learned for."""
    memory, box = SegmentCache(), boxes(2, 2)
    memory.train(*box, SPACING)
    assert same(memory.train(*box, spacing), som.train(*box, spacing))


def test_unchanged_maps_cost_nothing() -> None:
    """The same two Grid objects give the very same verdict; a copy gives an equal one."""
    a, b = fake_grid(fake_room()), fake_grid(fake_room(), 0.05, (0.5, 0.2, 1.0))
    cache = FusionCache()
    first = align(a, b, cache=cache)
    assert align(a, b, cache=cache) is first and learn(a, cache=cache) is learn(a, cache=cache)
    again = align(Grid(a.evidence, a.resolution, a.T_frame_grid), b)
    assert again is not first and again.T_target_source == first.T_target_source
