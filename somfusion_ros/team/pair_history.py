# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The history of one pair of maps: when to match it again, and which verdict holds.

A verdict that holds is replaced by another pose only if that is clearly better twice in a row,
so that the global map does not jump; a verdict at nearly the same pose is followed in small steps,
so that loop closures move the map smoothly.
"""

from dataclasses import replace

import cv2
import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import apply, Array, between, compose, inverse, Pose, wrap
from somfusion_ros.grid import Grid

SAME_DISTANCE = 0.5                # [m] at the walls of the source map; nearer is the same pose
SAME_HEADING = np.radians(5.0)     # [rad]
DOUBT_RATIO = 0.5                  # clearly better: at most this share of the doubt is left
CONFIRMATIONS = 2                  # times in a row before another pose replaces the one that holds
STEP_DISTANCE = 0.15               # [m] furthest that a pose that holds moves at once,
STEP_HEADING = np.radians(1.5)     # [rad]; the rest follows when the pair is matched again
LIKELY = 0.5                       # a refusal at this probability is no clear one
REFUSALS = 4                       # clear refusals in a row that withdraw a verdict
SOON = 5.0                         # [s] after which small changes of a map count as well, and a
#                                    rival is looked at again; longer where matching takes long:
TIME_SHARE = 40.0                  # a pair takes one part in so many of the time at most
LEAST_CHANGE = 0.002               # share of the walls that is no change at all
WALL_TOLERANCE = 1                 # cells that a wall may move without being a change


class Pair:
    """One pair of maps, from its first match on."""

    def __init__(self) -> None:
        self.held: Alignment | None = None
        self.last: Alignment | None = None
        self.attempts = 0
        self.settled = False   # whether the last word was said on the maps of now
        self._rivals: list[Alignment] = []
        self._on_the_way = False
        self._refusals = 0
        self._matched: tuple[Grid, Grid] | None = None
        self._matched_at = 0.0

    @property
    def doubted(self) -> bool:
        """Whether the verdict that holds was refused on the maps of now."""
        return self._refusals > 0

    def due(self, target: Grid, source: Grid, now: float, minimum_change: float) -> bool:
        """
        Tell whether one of the maps changed enough since they were last matched.

        After a while any change is enough, so that the last word is on the last maps, and a rival
        that waits for its confirmation needs none.
        """
        if self._matched is None:
            return True
        patience = max(SOON, TIME_SHARE * sum(self.last.seconds.values()))
        rested = now - self._matched_at >= patience
        changed = max(change(old, new) for old, new in zip(self._matched, (target, source)))
        self.settled = changed < LEAST_CHANGE and not self._unfinished
        if rested:
            return not self.settled
        return changed >= max(minimum_change, LEAST_CHANGE)

    def record(self, alignment: Alignment, target: Grid, source: Grid, now: float) -> str:
        """Take a verdict, given at a time [s], in; tell in one word what became of it."""
        self.last, self._matched, self._matched_at = alignment, (target, source), now
        self.attempts += 1
        word = self._weigh(alignment, source)
        self.settled = not self._unfinished
        return word

    @property
    def _unfinished(self) -> bool:
        """Whether the same maps are to be matched again: to confirm a rival, or to go on."""
        return bool(self._rivals) or self._on_the_way

    def _weigh(self, alignment: Alignment, source: Grid) -> str:
        """Weigh a verdict against the one that holds."""
        if self.held is None:
            return self._hold(alignment, 'accepted') if alignment.accepted else 'refused'
        same = self._same(alignment, source)
        if not alignment.accepted:
            return 'kept' if same and alignment.probability >= LIKELY else self._doubt()
        if same:
            return self._hold(self._towards(alignment), 'updated')
        return self._challenge(alignment, source)

    def _hold(self, alignment: Alignment, word: str) -> str:
        """Let a verdict hold from now on."""
        self.held, self._rivals, self._refusals = alignment, [], 0
        return word

    def _towards(self, alignment: Alignment) -> Alignment:
        """
        Go from the pose that holds towards a new verdict, by a small step at most.

        Small in either map: a turn about the origin of one moves that of the other far.
        """
        old, new = self.held.T_target_source, alignment.T_target_source
        step, other = between(old, new), between(inverse(old), inverse(new))
        size = max(np.hypot(step[0], step[1]) / STEP_DISTANCE, abs(step[2]) / STEP_HEADING,
                   np.hypot(other[0], other[1]) / STEP_DISTANCE)
        self._on_the_way = bool(size > 1.0)
        if not self._on_the_way:
            return alignment
        return replace(alignment, T_target_source=Pose.from_array(
            compose(old, step / size)))

    def _doubt(self) -> str:
        """Count a clear refusal; several in a row withdraw the verdict that holds."""
        self._rivals = []
        self._refusals += 1
        if self._refusals < REFUSALS:
            return 'kept'
        self.held, self._refusals, self._on_the_way = None, 0, False
        return 'withdrawn'

    def _challenge(self, rival: Alignment, source: Grid) -> str:
        """
        Replace the pose that holds once a clearly better one came often enough in a row.

        The maps have changed since the pose that holds was found. On the maps of now it is no
        better than the best pose beside the rival, the runner-up.
        """
        held_now = rival.runner_up.probability if rival.runner_up else 0.0
        if 1.0 - rival.probability > DOUBT_RATIO * (1.0 - held_now):
            self._rivals = []
            return 'kept'
        if self._rivals and not same_pose(self._rivals[-1].T_target_source,
                                          rival.T_target_source, source):
            self._rivals = []
        self._rivals.append(rival)
        return self._hold(rival, 'replaced') if len(self._rivals) >= CONFIRMATIONS else 'kept'

    def _same(self, alignment: Alignment, source: Grid) -> bool:
        """Tell whether a verdict found the pose that holds again."""
        if alignment.T_target_source is None:
            return False
        return same_pose(self.held.T_target_source, alignment.T_target_source, source)


def same_pose(first: Pose, second: Pose, source: Grid) -> bool:
    """Tell whether two poses put the walls of the source map in the same place."""
    points = source.points(source.occupied)
    centre = points.mean(0, keepdims=True) if len(points) else np.zeros((1, 2))
    distance = np.linalg.norm(apply(first, centre) - apply(second, centre))
    return bool(distance <= SAME_DISTANCE
                and abs(wrap(first.theta - second.theta)) <= SAME_HEADING)


def change(old: Grid, new: Grid) -> float:
    """Share of the walls of either map that the other one does not have, 0..1."""
    if old is new or (old.shape == new.shape and old.T_frame_grid == new.T_frame_grid
                      and np.array_equal(old.evidence, new.evidence)):
        return 0.0
    return max(missing_walls(old, new), missing_walls(new, old))


def missing_walls(grid: Grid, other: Grid) -> float:
    """Share of the walls of a map that the other one does not have, 0..1."""
    points = grid.points(grid.occupied)
    return 1.0 - float(_on_wall(points, other).mean()) if len(points) else 0.0


def _on_wall(points: Array, grid: Grid) -> Array:
    """Tell for map points (N, 2) whether they lie on a wall of a map, or one cell beside."""
    size = 2 * WALL_TOLERANCE + 1
    walls = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((size, size), np.uint8))
    cells = grid.point_to_cell(points)
    inside = ((cells >= 0) & (cells < grid.shape)).all(1)
    hit = np.zeros(len(points), dtype=bool)
    hit[inside] = walls[tuple(cells[inside].T)] > 0
    return hit
