# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The history of one pair of maps: when to match it again, and which verdict holds.

A verdict that holds is replaced by another pose only if that is clearly better twice in a row,
so that the global map does not jump; a verdict at nearly the same pose is followed in small steps,
so that loop closures move the map smoothly.
"""

from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import apply, between, compose, inverse, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.team.map_change import change

CONFIRMATIONS = 2    # times in a row before another pose replaces the one that holds
REFUSALS = 4         # clear refusals in a row that withdraw a verdict,
NEAR_REFUSALS = 12   # or so many of any kind


@dataclass(frozen=True)
class PairTuning:
    """When a pair is matched again, and what a verdict is worth against the one that holds."""

    same_distance: float = tuned(
        0.5, 'm', 'poses that differ by less at the walls of the source map are the same',
        'not measured')
    same_heading: float = tuned(
        float(np.radians(5.0)), 'rad', 'the same for the heading', 'not measured')
    doubt_ratio: float = tuned(
        0.5, '', 'a rival is clearly better where at most this share of the doubt is left',
        'not measured')
    step_distance: float = tuned(
        0.15, 'm', 'a pose that holds moves by this much at once; the rest follows when the pair '
        'is matched again, so that nobody is thrown off the map', 'by design')
    step_heading: float = tuned(
        float(np.radians(1.5)), 'rad', 'the same for the heading', 'by design')
    likely: float = tuned(
        0.5, '', 'a refusal at this probability, at the pose that holds, is no clear one',
        'not measured')
    soon: float = tuned(
        5.0, 's', 'after this time small changes of a map count as well, and a rival is looked at '
        'again; longer where matching takes long', 'not measured')
    time_share: float = tuned(
        40.0, '', 'a pair takes one part in so many of the time at most', 'by design')
    least_change: float = tuned(
        0.002, '', 'share of the walls that is no change at all', 'not measured')


TUNING = PairTuning()


class PairHistory:
    """One pair of maps, from its first match on."""

    def __init__(self) -> None:
        self.held: Alignment | None = None
        self.last: Alignment | None = None
        self.attempts = 0
        self.settled = False   # whether the last word was said on the maps of now
        self._rivals: list[Alignment] = []
        self._on_the_way = False
        self._refusals = self._near_refusals = 0
        self._matched: tuple[Grid, Grid] | None = None
        self._matched_at = 0.0
        self._compared: tuple[tuple[Grid, ...], float] = (), 0.0    # maps, and what changed

    @property
    def doubted(self) -> bool:
        """Whether the verdict that holds was refused on the maps of now."""
        return self._refusals + self._near_refusals > 0

    @property
    def probability(self) -> float:
        """Probability of the verdict that holds; that of the refusal where it is doubted."""
        if self.held is None or self.last is None:
            return 0.0
        return min(self.held.probability, self.last.probability if self.doubted else 1.0)

    def reconsider(self) -> bool:
        """
        Match anew, as a map went back, so that one clear refusal withdraws what holds.

        Return False where it was not matched since that happened last.
        """
        if self._matched is None:
            return False
        self._matched, self._rivals = None, []
        self._refusals = REFUSALS - 1 if self.held is not None else 0
        return True

    def due(self, target: Grid, source: Grid, now: float, minimum_change: float) -> bool:
        """
        Return whether one of the maps changed enough since they were last matched.

        After a while any change is enough, so that the last word is on the last maps, and a rival
        that waits for its confirmation needs none.
        """
        if self._matched is None or self.last is None:
            return True
        patience = max(TUNING.soon, TUNING.time_share * sum(self.last.seconds.values()))
        rested = now - self._matched_at >= patience
        changed = self._changed(*self._matched, target, source)
        self.settled = changed < TUNING.least_change and not self._unfinished
        if rested:
            return not self.settled
        return changed >= max(minimum_change, TUNING.least_change)

    def _changed(self, *maps: Grid) -> float:
        """Return how much two maps differ from two others; the same four are compared once."""
        if len(self._compared[0]) != len(maps) or any(
                one is not other for one, other in zip(maps, self._compared[0])):
            self._compared = maps, max(change(old, new) for old, new in zip(maps, maps[2:]))
        return self._compared[1]

    def record(self, alignment: Alignment, target: Grid, source: Grid, now: float,
               impossible: bool = False) -> str:
        """
        Record a verdict given at a time [s]; return in one word what became of it.

        impossible: its pose cannot be; where it is the one that holds, that is withdrawn at once.
        """
        self.last, self._matched, self._matched_at = alignment, (target, source), now
        self.attempts += 1
        word = self._weigh(alignment, source, impossible)
        self.settled = not self._unfinished
        return word

    @property
    def _unfinished(self) -> bool:
        """Whether the same maps are to be matched again: for a rival, a refusal, or to go on."""
        return bool(self._rivals) or self._on_the_way or self._refusals > 0

    def _weigh(self, alignment: Alignment, source: Grid, impossible: bool) -> str:
        """Weigh a verdict against the one that holds."""
        if self.held is None:
            return self._hold(alignment, 'accepted') if alignment.accepted else 'refused'
        held = _pose_of(self.held)
        same = (alignment.T_target_source is not None
                and same_pose(held, alignment.T_target_source, source))
        if not alignment.accepted:
            return self._doubt(clear=not (same and alignment.probability >= TUNING.likely),
                               proven=same and impossible)
        if same:
            return self._hold(self._towards(held, alignment), 'updated')
        return self._challenge(alignment, source)

    def _hold(self, alignment: Alignment, word: str) -> str:
        """Make a verdict the one that holds."""
        self.held, self._rivals = alignment, []
        self._refusals = self._near_refusals = 0
        return word

    def _towards(self, old: Pose, alignment: Alignment) -> Alignment:
        """
        Go from the pose that holds towards a new verdict, by a small step at most.

        Small in either map: a turn about the origin of one moves that of the other far.
        """
        new = _pose_of(alignment)
        step, other = between(old, new), between(inverse(old), inverse(new))
        size = max(np.hypot(step[0], step[1]) / TUNING.step_distance,
                   abs(step[2]) / TUNING.step_heading,
                   np.hypot(other[0], other[1]) / TUNING.step_distance)
        self._on_the_way = bool(size > 1.0)
        if not self._on_the_way:
            return alignment
        return replace(alignment, T_target_source=Pose.from_array(compose(old, step / size)))

    def _doubt(self, clear: bool, proven: bool) -> str:
        """Count a refusal; several in a row, or a proven one, withdraw the verdict that holds."""
        self._rivals, self._on_the_way = [], False     # there is nothing to go on towards
        self._refusals += clear
        self._near_refusals += 1
        if self._refusals < REFUSALS and self._near_refusals < NEAR_REFUSALS and not proven:
            return 'kept'
        self.held, self._refusals, self._near_refusals = None, 0, 0
        return 'withdrawn'

    def _challenge(self, rival: Alignment, source: Grid) -> str:
        """
        Replace the pose that holds once a clearly better one came often enough in a row.

        The maps have changed since the pose that holds was found. On the maps of now it is no
        better than the best pose beside the rival, the runner-up.
        """
        held_now = rival.runner_up.probability if rival.runner_up else 0.0
        if 1.0 - rival.probability > TUNING.doubt_ratio * (1.0 - held_now):
            self._rivals = []
            return 'kept'
        if self._rivals and not same_pose(_pose_of(self._rivals[-1]), _pose_of(rival), source):
            self._rivals = []
        self._rivals.append(rival)
        if len(self._rivals) < CONFIRMATIONS:
            return 'kept'
        self._on_the_way = False
        return self._hold(rival, 'replaced')


def _pose_of(alignment: Alignment) -> Pose:
    """Return the pose of an alignment that has one: every accepted one does."""
    if alignment.T_target_source is None:
        raise ValueError(f'an alignment without a pose cannot hold: {alignment.reason}')
    return alignment.T_target_source


def same_pose(first: Pose, second: Pose, source: Grid) -> bool:
    """Return whether two poses put the walls of the source map in the same place."""
    points = source.points(source.occupied)
    centre = points.mean(0, keepdims=True) if len(points) else np.zeros((1, 2))
    distance = np.linalg.norm(apply(first, centre) - apply(second, centre))
    return bool(distance <= TUNING.same_distance
                and abs(wrap(first.theta - second.theta)) <= TUNING.same_heading)
