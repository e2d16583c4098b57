# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Correlative scan matching: the best pose in a window, wherever the seed lies.

Branch and bound over the likelihood field (Olson 2009; Hess et al. 2016): coarser fields that
hold the maximum of each neighbourhood bound the score from above, so the search is exact and
no seed can mislead it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from somfusion_ros.geometry import Array, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.local_map import TUNING as FIELD
from somfusion_ros.slam.scan import Cloud

BLOCKS = (16, 8, 4)  # fine cells along a node's edge, level by level
BLOCK = BLOCKS[-1]
BATCH = 48        # finest nodes opened at a time
MOST = 40         # such batches at most
WIDE_BATCH = 96   # wider nodes opened at a time
CHUNK = 1024      # nodes scored at a time
Prior = Callable[[Array], Array]
Nodes = NDArray[np.intp]  # (3, M): turn, and row and column of the first translation


@dataclass(frozen=True)
class CorrelativeTuning:
    """How finely and how far a correlative search looks."""

    beams: int = tuned(
        90, 'points', 'points of a scan that are scored; more cost time in proportion',
        'shared logs')
    distinct: tuple[float, float] = tuned(
        (0.6, 0.2), 'm, rad', 'a rival pose is at least this far away', 'by design')
    turn_step: float = tuned(
        1.5, 'cells', 'the farthest point moves this far in the field per angular step',
        'not measured')
    turn_steps: tuple[float, float] = tuned(
        (0.005, 0.05), 'rad', 'bounds of the angular step', 'not measured')


TUNING = CorrelativeTuning()


@dataclass(frozen=True, eq=False)
class Peak:
    """The best pose T_map_scan (3,), its score in 0..1, and the best distinct rival's score."""

    pose: Array
    score: float
    rival: float


def search(scan: Cloud, target: LocalMap, centres: ArrayLike, reach: float, turn: float,
           prior: Prior | None = None, with_rival: bool = True, least: float = 0.0) -> Peak:
    """
    Find the best pose of a scan within `reach` [m] and `turn` [rad] of centres (n, 3).

    The angular step moves the farthest point by about one fine cell of the field. A prior takes
    poses (n, 3) to factors (n,) of their score in 0..1, nearly constant over a finest node.
    Without the rival, whatever cannot hold the best pose is left out early. A pose that does not
    score more than `least` is not looked for; where there is none, the first centre is returned.
    """
    if min(len(scan), len(target)) == 0:
        return Peak(np.atleast_2d(centres)[0].astype(float), 0.0, 0.0)
    field, corner = target.field
    points = scan.points[np.linspace(0, len(scan) - 1, min(TUNING.beams, len(scan))).astype(int)]
    arm = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80))
    step = np.clip(TUNING.turn_step * FIELD.field_step / max(arm, 0.5), *TUNING.turn_steps)
    turns = step * np.arange(-np.ceil(turn / step), np.ceil(turn / step) + 1)
    middles = np.atleast_2d(centres)[:, None] + turns[:, None] * (0.0, 0.0, 1.0)
    middles = middles.reshape(-1, 3)
    half = int(np.ceil(reach / (FIELD.field_step * BLOCK))) * BLOCK

    def poses(nodes: Nodes) -> Array:
        k, row, column = nodes
        shift = FIELD.field_step * np.stack([column - half, row - half, np.zeros_like(k)], axis=1)
        placed: Array = middles[k] + shift
        return placed

    margin = 2 * half + BLOCK    # a point this far outside may still enter the field
    fine = cv2.copyMakeBorder(field, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0)
    cells = _cells(points, middles - (*corner, 0.0), margin, half, fine.shape)
    descent = _Descent(fine, cells, 2 * half, lambda nodes: (
        1.0 if prior is None else prior(poses(nodes))), least)
    descent.run(BLOCKS[-1:] if with_rival else BLOCKS)
    if descent.place is None:
        return Peak(middles[len(turns) // 2], 0.0, 0.0)
    pose = poses(descent.place)[0]
    rival = descent.rival(descent.place, poses) if with_rival else 0.0
    pose[2] = wrap(pose[2])
    return Peak(pose, descent.best, rival)


def _cells(points: Array, poses: Array, margin: int, half: int, shape: tuple[int, int]
           ) -> NDArray[np.intp]:
    """Return cells (A, N) of the padded field, row by row, for the window's first corner."""
    (x, y), (left, down, theta) = points.T, poses.T[:, :, None]
    c, s = np.cos(theta), np.sin(theta)
    first = margin - half
    column = np.floor((c * x - s * y + left) / FIELD.field_step).astype(np.intp) + first
    row = np.floor((s * x + c * y + down) / FIELD.field_step).astype(np.intp) + first
    rows, columns = np.array(shape) - (2 * half + BLOCK) - 1
    cells: NDArray[np.intp] = np.clip(row, 0, rows) * shape[1] + np.clip(column, 0, columns)
    return cells


def _bounds(fine: Array, blocks: tuple[int, ...]) -> list[Array]:
    """Return the maximum over squares with edges `blocks`, powers of two, from each cell on."""
    wide, found, edge = fine, {}, 1
    while edge < max(blocks):
        corners = np.zeros((edge + 1, edge + 1), np.uint8)   # four squares make one twice as wide
        corners[::edge, ::edge] = 1
        wide, edge = cv2.dilate(wide, corners, anchor=(0, 0)), 2 * edge
        found[edge] = wide
    return [found[block] for block in blocks]


class _Descent:
    """
    Branch and bound: from coarse nodes to single cells, the most promising first.

    fine (H, W) is the field, cells (A, N) the points of every turn in it, last the largest row
    and column of the window; a factor in 0..1 of the score belongs to each finest node. The best
    place (3, 1) is None until one scores more than `least`.
    """

    def __init__(self, fine: Array, cells: NDArray[np.intp], last: int,
                 factor: Callable[[Nodes], Array | float], least: float) -> None:
        self._fine, self._cells, self._last, self._factor = fine, cells, last, factor
        self._weights = np.full(cells.shape[1], 1.0 / (255.0 * cells.shape[1]), np.float32)
        self._opened: list[tuple[Array, Nodes]] = []
        self.best = least
        self.place: Nodes | None = None

    def run(self, blocks: tuple[int, ...]) -> None:
        """Find the best score and its place; blocks: edge of the nodes of each level."""
        bounds = _bounds(self._fine, blocks)
        offset = np.arange(0, self._last + 1, blocks[0])
        nodes = np.reshape(np.meshgrid(np.arange(len(self._cells)), offset, offset,
                                       indexing='ij'), (3, -1))
        shift = (offset[:, None] * self._fine.shape[1] + offset).reshape(-1, 1)
        flat, some = bounds[0].ravel(), max(1, CHUNK // shift.size)
        scores = [(flat.take(self._cells[k:k + some, None] + shift) @ self._weights).ravel()
                  for k in range(0, len(self._cells), some)]
        self._descend(blocks, bounds, nodes, np.concatenate(scores))

    def _descend(self, blocks: tuple[int, ...], bounds: list[Array], nodes: Nodes,
                 scores: Array) -> None:
        """Open those nodes (3, M) that may hold something better than the best yet."""
        finest = len(blocks) == 1
        factors = np.broadcast_to(self._factor(nodes) if finest else 1.0, scores.shape)
        scores = scores * factors
        order = np.argsort(scores)[::-1]
        size = BATCH if finest else WIDE_BATCH
        if finest:
            order = order[:MOST * BATCH]
        for start in range(0, len(order), size):
            batch = order[start:start + size]
            if scores[batch[0]] <= self.best:
                break
            if finest:
                self._open(nodes[:, batch], factors[batch])
            else:
                batch = batch[scores[batch] > self.best]
                children = _split(nodes[:, batch], blocks[0], blocks[1])
                children = children[:, (children[1:] <= self._last).all(0)]
                self._descend(blocks[1:], bounds[1:], children,
                              self._scores(bounds[1], children))

    def _open(self, nodes: Nodes, factors: Array) -> None:
        """Score every cell of finest nodes."""
        cells = _split(nodes, BLOCK, 1)
        scores = self._scores(self._fine, cells) * factors.repeat(BLOCK ** 2)
        self._opened.append((scores.reshape(-1, BLOCK ** 2).max(1), nodes))
        k = int(scores.argmax())
        if scores[k] > self.best:
            self.best, self.place = float(scores[k]), cells[:, k:k + 1]

    def _scores(self, field: Array, nodes: Nodes) -> Array:
        """Return the mean (M,) of a field over the points, at each node."""
        offset = nodes[1] * field.shape[1] + nodes[2]
        cells = self._cells.take(nodes[0], 0) + offset[:, None]
        means: Array = field.ravel().take(cells) @ self._weights
        return means

    def rival(self, place: Nodes, poses: Callable[[Nodes], Array]) -> float:
        """Return the best score in the finest nodes opened that lie clearly off a place."""
        scores = np.concatenate([scores for scores, _ in self._opened])
        nodes = np.concatenate([nodes for _, nodes in self._opened], axis=1)
        x, y, theta = (poses(nodes) - poses(place)).T
        elsewhere = (np.hypot(x, y) > TUNING.distinct[0]) | (np.abs(theta) > TUNING.distinct[1])
        return float(scores[elsewhere].max()) if elsewhere.any() else 0.0


def _split(nodes: Nodes, block: int, smaller: int) -> Nodes:
    """Return the nodes (3, M * k) of a smaller edge that make up nodes (3, M)."""
    offset = np.arange(0, block, smaller)
    inner = np.reshape(np.meshgrid(0, offset, offset, indexing='ij'), (3, 1, -1))
    return (nodes[:, :, None] + inner).reshape(3, -1)
