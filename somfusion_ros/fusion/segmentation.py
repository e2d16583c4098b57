# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Segmentation of a map's occupied cells (Algorithm 1, equations (1)-(3)).

As published, circles of radius r grow around start cells, with the next starts in the ring of
width 1 at the rim of the circle, or of width delta_r where that is empty. On walls drawn without
holes wider than r the segments are the connected components of the graph that links cells at most
r apart, which `segment` finds at once. The tests hold it to the algorithm as published.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

Cells = NDArray[np.intp]


def segment(cells: Cells, shape: tuple[int, int], radius: float) -> NDArray[np.intp]:
    """
    Label cells so that cells at most `radius` apart share a label.

    Parameters
    ----------
    cells : (N, 2) distinct (row, column) of occupied cells of a grid of `shape`
    radius : r of Algorithm 1 [cells]

    Returns
    -------
    (N,) labels 0..S-1, numbered by the first cell of each segment
    """
    count = len(cells)
    if count == 0:
        return np.empty(0, np.intp)
    margin = int(radius)
    width = shape[1] + 2 * margin
    number = np.zeros((shape[0] + 2 * margin) * width, np.int32)   # 0: no wall, else cell + 1
    flat = (cells[:, 0] + margin) * width + cells[:, 1] + margin
    number[flat] = np.arange(1, count + 1)
    here, there = [], []
    for row, column in _half_disc(radius):
        other = number[flat + row * width + column]
        linked = np.flatnonzero(other)
        here.append(linked)
        there.append(other[linked] - 1)
    rows, columns = np.concatenate(here), np.concatenate(there)
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    labels: NDArray[np.intp] = connected_components(graph, directed=False)[1].astype(np.intp)
    return labels


def _half_disc(radius: float) -> list[tuple[int, int]]:
    """Return the offsets (row, column) of a disc without its centre, one of each opposite two."""
    reach = range(-int(radius), int(radius) + 1)
    return [(r, c) for r in reach for c in reach
            if (r, c) > (0, 0) and r * r + c * c <= radius * radius]
