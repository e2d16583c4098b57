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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned

Index = NDArray[np.intp]
FAR = 1e9           # where the neurons are that are none [m]
ROW_BITS = np.int32(15)


@dataclass(frozen=True)
class SomSettings:
    """Numbers that the self-organising map was tuned with."""

    batch: int = tuned(
        16384, 'cells',
        'are looked at in a row: the caches hold them with all that is computed',
        'benchmarks/fusion/growth.py')
    phase: float = tuned(
        0.137, 'm',
        'keeps walls at round distances from the edges of the squares',
        'by design')


SOM = SomSettings()


def presentations(evidence: Array, delta: float) -> Array:
    """Count how often each cell is presented: round(|C| / delta), at least once (4)."""
    return np.maximum(np.rint(np.abs(evidence) / delta), 1.0)


def train(points: Array, times: Array, segments: Index, spacing: float,
          passes: int = 3) -> tuple[Array, Index, Index, Index]:
    """
    Learn the clusters of all segments.

    Parameters
    ----------
    points : (N, 2) cell centres [m], at least one
    times : (N,) presentations of each cell
    segments : (N,) segment of each cell
    spacing : distance of neighbouring neurons along a wall [m]
    passes : batch passes; the neighbourhood shrinks to the winner in the last one

    Returns
    -------
    centres (K, 2) [m], the segment (K,) of each neuron, edges (E, 2) between adjacent neurons,
    and the winner (N,) of each cell
    """
    home, of, near = _neighbourhoods(points, segments, spacing)
    centres = _means(points, times, home)
    near = np.take(near.T, home, axis=1)
    for step in range(passes):
        winner, runner = _two_nearest(points, centres, near)
        share = 0.5 * (1.0 - (step + 1) / passes)
        centres = _pull(points, times, winner, runner, share, centres)
    return _finish(centres, of, winner, runner)


def _neighbourhoods(points: Array, segments: Index,
                    spacing: float) -> tuple[Index, Index, Index]:
    """
    Give every square of edge `spacing` in which a segment has cells a first neuron.

    Returns
    -------
    (N,) first neuron of each cell, (K,) segment of each neuron, and (K, 9) the neurons of the
    same segment in the squares around, K where there is none: one of them wins in every pass
    """
    # Squares are those of the frame, so that a segment's clusters depend on its cells alone.
    squares = np.floor((points + SOM.phase) / spacing).astype(np.int64)
    squares -= squares.min(0) - 1
    columns, rows = squares.max(0) + 2
    key = (segments.astype(np.int64) * rows + squares[:, 1]) * columns + squares[:, 0]
    keys, home = np.unique(key, return_inverse=True)
    around = np.array([row * columns + column for row in (-1, 0, 1) for column in (-1, 0, 1)])
    wanted = keys[:, None] + around
    found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return home, keys // (rows * columns), np.where(keys[found] == wanted, found, len(keys))


def _means(points: Array, times: Array, winner: Index) -> Array:
    """Return means (K, 2) of the cells that each neuron wins, weighted by their presentations."""
    mass = np.bincount(winner, times)
    return np.column_stack([np.bincount(winner, times * axis) / mass for axis in points.T])


def _two_nearest(points: Array, centres: Array, near: Index) -> tuple[Index, Index]:
    """Return winner (N,) and runner-up (N,) of each cell among the neurons (k, N) near it."""
    table = np.vstack([centres, [FAR, FAR]]).astype(np.float32).T
    found = [_two_of(points[k:k + SOM.batch], table, near[:, k:k + SOM.batch])
             for k in range(0, len(points), SOM.batch)]
    winner, runner = (np.concatenate(part) for part in zip(*found, strict=True))
    return winner, runner


def _two_of(points: Array, table: NDArray[np.float32], near: Index) -> tuple[Index, Index]:
    """Do it for one batch of cells, with the neurons (2, K) and one at the end that is none."""
    x, y = points.T.astype(np.float32)
    across, up = np.take(table, near, axis=1)
    distance = (across - x) ** 2 + (up - y) ** 2
    # Floats above zero are in the order of their bits: the lowest hold the row, so that a
    # minimum says where it was found.
    tagged = distance.view(np.int32) & ~ROW_BITS | np.arange(len(near), dtype=np.int32)[:, None]
    every, first = np.arange(len(points)), tagged.min(0) & ROW_BITS
    tagged[first, every] = np.iinfo(np.int32).max
    winner, runner = near[first, every], near[tagged.min(0) & ROW_BITS, every]
    return winner, np.where(runner == table.shape[1] - 1, winner, runner)


def _pull(points: Array, times: Array, winner: Index, runner: Index, share: float,
          centres: Array) -> Array:
    """Do one batch pass: every neuron goes to its cells' mean, runners-up count for `share`."""
    count = len(centres)
    mass = np.bincount(winner, times, count) + share * np.bincount(runner, times, count)
    moved = [np.bincount(winner, times * axis, count)
             + share * np.bincount(runner, times * axis, count) for axis in points.T]
    return np.where(mass[:, None] > 0, np.column_stack(moved) / np.maximum(mass, 1e-12)[:, None],
                    centres)


def _finish(centres: Array, of: Index, winner: Index,
            runner: Index) -> tuple[Array, Index, Index, Index]:
    """Drop neurons that won nothing, and read off adjacency: a cell joins its two nearest."""
    alive = np.bincount(winner, minlength=len(centres)) > 0
    number, count = np.cumsum(alive) - 1, max(int(alive.sum()), 1)
    low, high = np.minimum(winner, runner), np.maximum(winner, runner)
    joined = alive[runner] & (low != high)
    edges = np.unique(number[low[joined]] * count + number[high[joined]])
    return (centres[alive], of[alive], np.column_stack(np.divmod(edges, count)), number[winner])
