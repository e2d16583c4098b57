# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether the rest of either map hangs together with what both maps saw.

A robot that was in a room that both maps show has come in somewhere, and its map goes on there.
Where a single room fits by chance, the other map shows wall at every place where this one goes
on: all doors are contradicted, though the walls coincide.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.rasters import FREE, NEAR
from somfusion_ros.geometry import apply, Array
from somfusion_ros.settings import tuned

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PassageSettings:
    """Numbers that the passages were tuned with."""

    step: float = tuned(
        0.2, 'm', 'between the places that are looked at: a door is four of them wide, of which '
        'the surroundings of its posts leave two', 'by design')
    most: int = tuned(
        4_000_000, 'places', 'of one map, more steps apart beyond: bounds time and memory',
        'by design')
    main: float = tuned(
        0.25, 'share', 'of the largest part of the common area that a part needs to count: behind '
        'a wall that lies beside its image there are slivers', 'by design')
    little: float = tuned(
        3.0, 'm2', 'of a map that lie elsewhere, or less, are as good as nothing: half a room',
        'by design')


PASSAGES = PassageSettings()


def passable(seen: LearnedMap, by: LearnedMap,
             lay: Callable[[Array], NDArray[np.float32]]) -> float:
    """
    Return how much of a map's free area is the common one, or reached from there, 0..1.

    Reached in the map as it is, and at the same time not through the walls of the other. Places
    that the other map knows, and those that cannot be reached at all, are not asked for.

    Parameters
    ----------
    seen, by : the map, and the other, whose walls count
    lay : takes points (K, 2) of the first to places (2, 1, K) in the frame of the other
    """
    zones = seen.zones
    stride = max(1, round(PASSAGES.step / zones.resolution),
                 int(np.ceil(np.sqrt(zones.values.size / PASSAGES.most))))
    free = (zones.values[::stride, ::stride] & FREE) > 0
    row, column = np.nonzero(free)
    at = (np.column_stack([column, row]) * stride + 0.5) * zones.resolution
    there = by.zones.at(lay(apply(zones.T_frame_raster, at)))[0]
    both, unseen, open_ = (there & (FREE | NEAR)) == FREE, there == 0, (there & NEAR) == 0
    whole = unseen & _joined(free, row, column, both)
    free[row, column] = open_
    reached = whole & _joined(free, row, column, both)
    area = (stride * zones.resolution) ** 2
    common = np.count_nonzero(both) * area + PASSAGES.little
    return float((np.count_nonzero(reached) * area + common)
                 / (np.count_nonzero(whole) * area + common))


def _joined(free: Mask, row: Index, column: Index, both: Mask) -> Mask:
    """
    Tell which places (N,) of an image (H, W) are free and hang together with the common ones.

    row, column (N,) of the places; both (N,): whether both maps saw it free.
    """
    count, label = cv2.connectedComponents(free.view(np.uint8), connectivity=4)
    label = label[row, column]
    held = np.bincount(label[both], minlength=count)
    held[0] = 0     # what is not free in this image
    return np.asarray((held >= max(PASSAGES.main * held.max(), 1.0))[label])
