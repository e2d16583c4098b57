# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells that are drawn anew, against masks of the whole map."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.slam.dirty_cells import DirtyCells

SIDE = 12
WINDOW = st.tuples(st.integers(0, SIDE - 2), st.integers(0, SIDE - 2), st.integers(1, SIDE),
                   st.integers(1, SIDE)).map(
    lambda w: (w[0], w[1], min(w[0] + w[2], SIDE), min(w[1] + w[3], SIDE)))
WINDOWS = st.lists(WINDOW, min_size=1, max_size=4).map(np.array)


@given(WINDOWS, WINDOWS)
@settings(max_examples=50, deadline=None)
def test_they_are_those_of_a_mask_of_the_whole_map(changed, asked):
    whole = np.zeros((SIDE, SIDE), bool)
    for x0, y0, x1, y1 in changed:
        whole[y0:y1, x0:x1] = True
    dirty, marked = DirtyCells.of(changed), np.zeros_like(whole)
    marked[dirty.window][dirty.mask] = True
    assert np.array_equal(marked, whole)
    parts = [whole[y0:y1, x0:x1] for x0, y0, x1, y1 in asked]
    assert dirty.touch(asked).tolist() == [part.any() for part in parts]
    for window, part in zip(asked, parts, strict=True):
        assert np.array_equal(dirty.within(window), part)
