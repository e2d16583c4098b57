# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where to look when two poses of a map are both likely: the place that tells them apart."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.rasters import FREE, NEAR, WALL
from somfusion_ros.geometry import Array, inverse, place, Pose
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class LookoutSettings:
    """Numbers that the choice of a lookout was tuned with."""

    step: float = tuned(
        0.25, 'm', 'between the places that are compared, more in a map of more than `places`',
        'by design')
    places: int = tuned(200_000, 'places', 'are compared at most: bounds the time', 'by design')
    sight: float = tuned(
        4.0, 'm', 'a robot sees at least so far: the range of a cheap lidar indoors', 'by design')
    least: float = tuned(
        0.5, 'm2', 'of places that differ are worth a drive', 'by design')


LOOKOUT = LookoutSettings()


def lookout(target: LearnedMap, source: LearnedMap, first: Array, second: Array) -> Pose | None:
    """
    Choose a place from where two poses of the source map can be told apart.

    It is a free place of the target map around which most is unknown that one of the poses
    predicts to be wall, and the other to be free.

    Parameters
    ----------
    target, source : LearnedMap
        Two maps.
    first, second : (3,) arrays
        Two candidates for T_target_source.

    Returns
    -------
    Pose or None
        In the target's map frame, facing what is to be seen; None where the two predict the same.
    """
    points, shape, step = _lattice(target)
    zones = target.zones.at(points)
    predicted = [source.zones.at(place(inverse(pose)[None], points.T)[:, 0])
                 for pose in (first, second)]
    wall, free = ([(seen & flag) > 0 for seen in predicted] for flag in (WALL, FREE))
    differs = ((wall[0] & free[1]) | (free[0] & wall[1])) & (zones & (FREE | NEAR) == 0)
    seen = _within_sight(differs.reshape(shape), step)
    worth = np.where((zones & FREE > 0).reshape(shape), seen, 0.0)
    best = int(worth.argmax())
    if worth.ravel()[best] * step ** 2 < LOOKOUT.least:
        return None
    spot = points[:, best]
    near = differs & (np.hypot(*(points - spot[:, None])) < (_reach(step) + 1e-3) * step)
    ahead = points[:, near].mean(1) - spot
    return Pose(float(spot[0]), float(spot[1]), float(np.arctan2(ahead[1], ahead[0])))


def _lattice(target: LearnedMap) -> tuple[NDArray[np.float32], tuple[int, int], float]:
    """Return the places (2, N) of a lattice over what a map shows, its shape and step [m]."""
    low, high = target.cells.min(0) - LOOKOUT.sight, target.cells.max(0) + LOOKOUT.sight
    step = max(LOOKOUT.step, float(np.sqrt(np.prod(high - low) / LOOKOUT.places)))
    x, y = (np.arange(a, b, step, dtype=np.float32) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(x, y)).reshape(2, -1), (len(y), len(x)), step


def _within_sight(differs: NDArray[np.bool_], step: float) -> Array:
    """Count the places that differ within sight of each place."""
    reach = _reach(step)
    row, column = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    disc = (np.hypot(row, column) <= reach).astype(np.float32)
    return cv2.filter2D(differs.astype(np.float32), cv2.CV_32F, disc,
                        borderType=cv2.BORDER_CONSTANT)


def _reach(step: float) -> int:
    """Return how many steps [m] a robot sees."""
    return max(1, round(LOOKOUT.sight / step))
