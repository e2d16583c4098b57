# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Correlative scan matching: the best pose in a window, wherever the seed lies.

Branch and bound over the likelihood field (Olson 2009; Hess et al. 2016): a coarse field that
holds the maximum of each neighbourhood bounds the score from above, so the search is exact and
no seed can mislead it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from somfusion_ros.geometry import Array, rotation, wrap
from somfusion_ros.slam.local_map import FIELD_STEP, LocalMap
from somfusion_ros.slam.scan import Cloud

BLOCK = 4         # fine cells along a coarse cell's edge
BEAMS = 90        # points of a scan that are scored
BATCH = 48        # coarse nodes opened at a time
Prior = Callable[[Array], Array]
DISTINCT = (0.6, 0.2)  # [m] [rad] a rival is at least this far away


@dataclass(frozen=True, eq=False)
class Peak:
    """The best pose T_map_scan (3,), its score in 0..1, and the best distinct rival's score."""

    pose: Array
    score: float
    rival: float


def search(scan: Cloud, target: LocalMap, centre: Array, reach: float, turn: float,
           prior: Prior | None = None) -> Peak:
    """
    Best pose of a scan within `reach` [m] and `turn` [rad] of the centre pose (3,).

    The angular step moves the farthest point by about one fine cell of the field. A prior takes
    poses (n, 3) to factors (n,) of their score in 0..1, nearly constant over a coarse cell.
    """
    field, corner = target.field
    points = scan.points[np.linspace(0, len(scan) - 1, min(BEAMS, len(scan))).astype(int)]
    arm = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80))
    step = np.clip(1.5 * FIELD_STEP / max(arm, 0.5), 0.005, 0.05)
    turns = step * np.arange(-np.ceil(turn / step), np.ceil(turn / step) + 1)
    half = int(np.ceil(reach / (FIELD_STEP * BLOCK))) * BLOCK
    margin = 2 * half + BLOCK    # a point this far outside may still enter the field
    fine = cv2.copyMakeBorder(field, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0)
    bound = cv2.dilate(fine, np.ones((BLOCK, BLOCK), np.uint8), anchor=(0, 0))
    cells = _cells(points, centre[2] + turns, centre[:2] - corner, margin, half, fine.shape)
    scores = _block_scores(bound, cells, half)
    factors = np.ones_like(scores) if prior is None else _factors(prior, centre, turns, half)
    scores = scores * factors
    order = np.argsort(scores, axis=None)[::-1]
    best, found, opened = -1.0, (0, 0, 0), []
    for start in range(0, min(len(order), 40 * BATCH), BATCH):
        nodes = order[start:start + BATCH]
        if scores.flat[nodes[0]] <= best:
            break
        a, row, column = np.unravel_index(nodes, scores.shape)
        values = _open(fine, cells[a], row * BLOCK, column * BLOCK)
        values = values * factors.flat[nodes][:, None, None]
        opened.append((values.max(axis=(1, 2)), a, row, column))
        k = int(values.argmax())
        if values.flat[k] > best:
            best = float(values.flat[k])
            node, dy, dx = np.unravel_index(k, values.shape)
            found = (a[node], row[node] * BLOCK + dy, column[node] * BLOCK + dx)
    pose = np.array([centre[0] + (found[2] - half) * FIELD_STEP,
                     centre[1] + (found[1] - half) * FIELD_STEP,
                     wrap(centre[2] + turns[found[0]])])
    return Peak(pose, best, _rival(opened, found, turns))


def _factors(prior: Prior, centre: Array, turns: Array, half: int) -> Array:
    """Prior (A, B, B) of every coarse node."""
    offset = np.arange(-half, half + 1, BLOCK) * FIELD_STEP
    theta, y, x = np.meshgrid(turns, offset, offset, indexing='ij')
    poses = centre + np.stack([x, y, theta], -1).reshape(-1, 3)
    return prior(poses).reshape(theta.shape)


def _cells(points: Array, turns: Array, offset: Array, margin: int, half: int,
           shape: tuple[int, int]) -> NDArray[np.intp]:
    """Cells (A, N, 2) row, column in the padded field, shifted to the window's first corner."""
    p = points @ rotation(turns).transpose(0, 2, 1) + offset
    cells = np.floor(p[..., ::-1] / FIELD_STEP).astype(np.intp) + (margin - half)
    return np.clip(cells, 0, np.array(shape) - (2 * half + BLOCK) - 1)


def _block_scores(bound: Array, cells: NDArray[np.intp], half: int) -> Array:
    """Upper bound of the score (A, B, B) of every turn and coarse translation."""
    side = 2 * half + 1
    windows = sliding_window_view(bound, (side, side))[:, :, ::BLOCK, ::BLOCK]
    return np.stack([windows[turn[:, 0], turn[:, 1]].mean(0) for turn in cells])


def _open(fine: Array, cells: NDArray[np.intp], row: NDArray[np.intp],
          column: NDArray[np.intp]) -> Array:
    """Scores (K, BLOCK, BLOCK) of the fine translations inside K coarse nodes."""
    windows = sliding_window_view(fine, (BLOCK, BLOCK))
    return windows[cells[:, :, 0] + row[:, None], cells[:, :, 1] + column[:, None]].mean(1)


def _rival(opened: list[tuple], found: tuple[int, int, int], turns: Array) -> float:
    """Best score among the opened nodes that lie clearly elsewhere."""
    if not opened:
        return 0.0
    value, a, row, column = (np.concatenate(part) for part in zip(*opened, strict=True))
    apart = np.hypot(row * BLOCK - found[1], column * BLOCK - found[2]) * FIELD_STEP
    elsewhere = (apart > DISTINCT[0]) | (np.abs(turns[a] - turns[found[0]]) > DISTINCT[1])
    return float(value[elsewhere].max()) if elsewhere.any() else 0.0
