# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Clusters of segments learned lately: a map that changed a little is learned where it changed.

A segment's clusters depend on its own cells alone, so those of an equal segment are taken over.
Cells are told apart in the map frame, so that a map may grow around its segments.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion import som
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned

Index = NDArray[np.intp]
Chains = tuple[Array, Index, Index, Index]   # centres, segments, edges and winners of som.train
PER_METRE = 1024    # cells are told apart at about a millimetre


@dataclass(frozen=True)
class CacheSettings:
    """Numbers that bound the cache of segments."""

    worth: int = tuned(
        64, 'cells',
        'from which a segment is worth remembering',
        'benchmarks/team/growth.py')
    most: int = tuned(
        4096, 'segments',
        'are remembered at most: bounds the memory',
        'by design')


CACHE = CacheSettings()


class SegmentCache:
    """Remembers the clusters of segments by their cells."""

    def __init__(self) -> None:
        """Start empty."""
        self._known: dict[tuple[float, bytes], tuple[Array, Index, Index]] = {}
        self.learned_cells = 0      # cells that were presented so far

    def train(self, points: Array, times: Array, segments: Index, spacing: float) -> Chains:
        """Do the same as `som.train`, learning only the segments that are not known."""
        keys = self._keys(points, times, segments, spacing)
        known = {label: self._known[key] for label, key in keys.items() if key in self._known}
        fresh = ~np.isin(segments, list(known))
        self.learned_cells += int(fresh.sum())
        learned = som.train(points[fresh], times[fresh], segments[fresh], spacing) \
            if fresh.any() else (np.empty((0, 2)), *np.empty((3, 0), np.intp))
        self._remember(learned, segments[fresh],
                       {label: key for label, key in keys.items() if label not in known})
        return learned if not known else _together(learned, fresh, known, segments)

    def _keys(self, points: Array, times: Array, segments: Index,
              spacing: float) -> dict[int, tuple[float, bytes]]:
        """Name the segments that are worth it by their cells."""
        order = np.argsort(segments, kind='stable')
        cells = np.column_stack([np.rint(points * PER_METRE), times]).astype(np.int32)[order]
        ends = np.cumsum(np.bincount(segments))
        starts = np.concatenate([[0], ends[:-1]])
        return {int(label): (spacing, cells[starts[label]:ends[label]].tobytes())
                for label in np.flatnonzero(ends - starts >= CACHE.worth)}

    def _remember(self, learned: Chains, segments: Index,
                  keys: dict[int, tuple[float, bytes]]) -> None:
        """Keep the clusters of segments; the oldest are forgotten."""
        centres, of, edges, winner = learned
        low, high = (np.searchsorted(of, list(keys), side=side) for side in ('left', 'right'))
        first, last = (np.searchsorted(edges[:, 0], ends) for ends in (low, high)) \
            if len(edges) else (low * 0, high * 0)
        order = np.argsort(segments, kind='stable')
        begin, end = (np.searchsorted(segments[order], list(keys), side=side)
                      for side in ('left', 'right'))
        for n, key in enumerate(keys.values()):
            self._known[key] = (centres[low[n]:high[n]], edges[first[n]:last[n]] - low[n],
                                winner[order[begin[n]:end[n]]] - low[n])
        while len(self._known) > CACHE.most:
            del self._known[next(iter(self._known))]


def _together(learned: Chains, fresh: NDArray[np.bool_],
              known: dict[int, tuple[Array, Index, Index]], segments: Index) -> Chains:
    """Put learned and remembered clusters in the order in which `som.train` gives them."""
    centres, of, edges, winner = [learned[0]], [learned[1]], [learned[2]], np.empty(
        len(segments), np.intp)
    winner[fresh], count = learned[3], len(learned[0])
    for label, (places, joined, won) in known.items():
        centres.append(places)
        of.append(np.full(len(places), label))
        edges.append(joined + count)
        winner[segments == label] = won + count
        count += len(places)
    labels = np.concatenate(of)
    order = np.argsort(labels, kind='stable')
    number = np.empty(count, np.intp)
    number[order] = np.arange(count)
    joined = number[np.concatenate([part.reshape(-1, 2) for part in edges])]
    joined = joined[np.lexsort(joined.T[::-1])]
    return np.concatenate(centres)[order], labels[order], joined, number[winner]
