# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What is shown follows what was solved, in steps: nobody who navigates in it is thrown about.

All views take the same share of their way in a step, so that the map keeps its shape. Whoever has
the same solution shows the same in the end, to the bit.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between, compose, wrap
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class GlideTuning:
    """How far what is shown moves at once."""

    distance: float = tuned(0.15, 'm', 'that a view moves in one step, as a pair that holds',
                            'by design')
    heading: float = tuned(float(np.radians(1.5)), 'rad', 'the same for the heading', 'by design')
    period: float = tuned(1.0, 's', 'between two steps', 'by design')
    steps: float = tuned(10.0, 'steps', 'a solution that is farther away is shown at once, and '
                         'said: else what is known to be wrong would be shown for long',
                         'by design')


TUNING = GlideTuning()


class Glide:
    """The poses (n, 3) of all views as they are shown, by robot, and where they are bound for."""

    def __init__(self, say: Callable[[str], object] = lambda text: None) -> None:
        self._say = say
        self._goal: dict[str, Array] = {}
        self._group: Hashable = None
        self._due = -np.inf
        self.shown: dict[str, Array] = {}

    @property
    def arrived(self) -> bool:
        """Whether all that was solved is shown."""
        return self.shown is self._goal

    def aim(self, poses: Mapping[str, Array], group: Hashable) -> None:
        """
        Take a new solution.

        group: what it is the solution of. That of another group, as after a merge or a reset, and
        one that lies far from what is shown, is shown at once; the others come in steps.
        """
        self._goal = dict(poses)
        if group != self._group or self.shown.keys() != self._goal.keys() or not poses:
            self._group, self.shown = group, self._goal
            return
        self.shown = {robot: _extended(self.shown[robot], goal)
                      for robot, goal in self._goal.items()}
        distance, heading = self._left()
        left = _steps(distance, heading)
        if left > TUNING.steps:
            self._say(f'the joint solution moved by up to {distance:.1f} m and '
                      f'{np.degrees(heading):.0f} deg: it is shown at once')
        if left > TUNING.steps or left == 0.0:
            self.shown = self._goal

    def keep(self, robots: Iterable[str]) -> None:
        """Show no others any more: their maps are other ones now."""
        kept = {*robots}
        if not self.shown.keys() <= kept:
            goal = {name: poses for name, poses in self._goal.items() if name in kept}
            self.shown = goal if self.arrived or not goal else {
                name: poses for name, poses in self.shown.items() if name in kept}
            self._goal = goal

    def step(self, now: float) -> None:
        """Go a step further, where it is time [s] for one."""
        if self.arrived or now < self._due:
            return
        self._due = now + TUNING.period
        left = _steps(*self._left())
        self.shown = self._goal if left <= 1.0 else {
            robot: _toward(shown, self._goal[robot], 1.0 / left)
            for robot, shown in self.shown.items()}

    def _left(self) -> tuple[float, float]:
        """Return how far [m] [rad] the views that have the longest way are from their goals."""
        d = np.concatenate([self._goal[robot] - shown for robot, shown in self.shown.items()])
        return float(np.hypot(d[:, 0], d[:, 1]).max()), float(np.abs(wrap(d[:, 2])).max())


def _steps(distance: float, heading: float) -> float:
    """Return how many steps a way [m] [rad] takes."""
    return max(distance / TUNING.distance, heading / TUNING.heading)


def _extended(shown: Array, goal: Array) -> Array:
    """Lay views (n, 3) that are new on from the last one that is shown, as they are solved."""
    last = min(len(shown), len(goal)) - 1
    new = compose(shown[last], between(goal[last], goal[last + 1:]))
    return np.concatenate([shown[:last + 1], new])


def _toward(shown: Array, goal: Array, share: float) -> Array:
    """Move poses (n, 3) a share of their way."""
    d = goal - shown
    d[:, 2] = wrap(d[:, 2])
    moved: Array = shown + share * d
    moved[:, 2] = wrap(moved[:, 2])
    return moved
