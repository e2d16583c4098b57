# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Kohonen's self-organising map on the cells of every segment (section II-B, equation (4)).

A cell is presented round(|C| / delta) times, so that sure cells pull more. The batch form of the
learning has the same fixed point as the published one-by-one form and needs a handful of passes.
The number of neurons follows the length of the segments. Neurons are adjacent where a cell lies
between the two (competitive Hebbian learning, Martinetz and Schulten 1994), which makes a chain
of a wall and a graph of a crossing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from somfusion_ros.geometry import Array

Index = NDArray[np.intp]


def presentations(evidence: Array, delta: float) -> Array:
    """How often each cell is presented: round(|C| / delta), at least once (4)."""
    return np.maximum(np.rint(np.abs(evidence) / delta), 1.0)


def train(points: Array, times: Array, segments: Index, spacing: float,
          passes: int = 3) -> tuple[Array, Index, Index, Index]:
    """
    Learn the clusters of all segments.

    Parameters
    ----------
    points : (N, 2) cell centres [m]
    times : (N,) presentations of each cell
    segments : (N,) segment of each cell
    spacing : distance of neighbouring neurons along a wall [m]
    passes : batch passes; the neighbourhood shrinks to the winner in the last one

    Returns
    -------
    centres (K, 2) [m], the segment (K,) of each neuron, edges (E, 2) between adjacent neurons,
    and the winner (N,) of each cell
    """
    winner, runner = _initial(points, segments, spacing), None
    centres, mass = _means(points, times, winner, winner.max() + 1)
    for step in range(passes):
        near = cKDTree(centres).query(points, k=min(2, len(centres)))[1].reshape(len(points), -1)
        winner, runner = near[:, 0], near[:, -1]
        share = 0.5 * (1.0 - (step + 1) / passes)
        centres, mass = _update(points, times, winner, runner, share, centres)
        if step == 0:
            centres = centres[mass > 0]
    return _finish(centres, mass, winner, runner, segments)


def _initial(points: Array, segments: Index, spacing: float) -> Index:
    """One neuron for every square of edge `spacing` in which a segment has cells."""
    squares = np.floor((points - points.min(0)) / spacing).astype(np.int64)
    rows, columns = squares[:, 1].max() + 1, squares[:, 0].max() + 1
    key = (segments.astype(np.int64) * rows + squares[:, 1]) * columns + squares[:, 0]
    return np.unique(key, return_inverse=True)[1]


def _means(points: Array, times: Array, winner: Index, count: int) -> tuple[Array, Array]:
    """Mean (K, 2) and mass (K,) of the cells that each neuron wins."""
    mass = np.bincount(winner, times, count)
    sums = np.column_stack([np.bincount(winner, times * points[:, k], count) for k in (0, 1)])
    return sums / np.maximum(mass, 1e-12)[:, None], mass


def _update(points: Array, times: Array, winner: Index, runner: Index, share: float,
            centres: Array) -> tuple[Array, Array]:
    """One batch pass: every neuron goes to its cells' mean, runners-up count for `share`."""
    count = len(centres)
    mass = np.bincount(winner, times, count)
    total = mass + share * np.bincount(runner, times, count)
    moved = np.empty_like(centres)
    for k in (0, 1):
        pull = times * points[:, k]
        moved[:, k] = np.bincount(winner, pull, count) + share * np.bincount(runner, pull, count)
    return np.where(total[:, None] > 0, moved / np.maximum(total, 1e-12)[:, None], centres), mass


def _finish(centres: Array, mass: Array, winner: Index, runner: Index,
            segments: Index) -> tuple[Array, Index, Index, Index]:
    """Drop neurons that won nothing, and read off segments and adjacency."""
    alive = mass > 0
    number = np.cumsum(alive) - 1
    of_segment = np.zeros(len(centres), np.intp)
    of_segment[winner] = segments
    ends = np.sort(np.column_stack([winner, runner]), axis=1)
    ends = ends[alive[ends].all(1) & (ends[:, 0] != ends[:, 1])]
    ends = ends[of_segment[ends[:, 0]] == of_segment[ends[:, 1]]]
    edges = np.unique(number[ends[:, 0]] * alive.sum() + number[ends[:, 1]])
    edges = np.column_stack(np.divmod(edges, max(int(alive.sum()), 1)))
    return centres[alive], of_segment[alive], edges, number[winner]
