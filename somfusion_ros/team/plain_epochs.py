# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which map it is that a SLAM publishes.

slam_node says it itself. Of any other SLAM a rule must do: its map is another one where another
publisher publishes it, or where most of its walls and half of its area are gone.
"""

from dataclasses import dataclass
from typing import NamedTuple

from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.map_change import begun_anew
from somfusion_ros.team.shared_map import MapCells

Loaded = tuple[int, int]    # map_load_time [s, ns] of a map
UNKNOWN = 'plain'           # start of a SLAM whose publisher was not noticed yet


class PlainMap(NamedTuple):
    """A map as a SLAM publishes it, and the time at which it says that it was loaded."""

    cells: MapCells
    loaded: Loaded = (0, 0)


@dataclass(frozen=True)
class PlainTuning:
    """How long a map waits for the word on what it is."""

    patience: float = tuned(
        2.0, 's', 'a first map waits this long for the word of its SLAM, before the rule for '
        'plain ones is used; discovery takes a part of it', 'by design')
    fresh: float = tuned(
        4.0, 's', 'a map that came within this time before another publisher was noticed is taken '
        "for that publisher's: twice the time between two looks at who is there", 'by design')


TUNING = PlainTuning()


class PlainEpochs:
    """The epochs of maps that come from a SLAM directly, by robot; times [s] are steady."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[Epoch, Loaded]] = {}
        self._first: dict[str, float] = {}
        self._publishers: dict[str, str] = {}
        self._named: dict[str, Epoch] = {}
        self._last: dict[str, tuple[Grid, float]] = {}

    def tell(self, robot: str, epoch: Epoch, loaded: Loaded) -> None:
        """Note what a SLAM says of itself: its map's epoch, and the load time that marks it."""
        self._told[robot] = epoch, loaded

    def untell(self, robot: str) -> None:
        """Note that no SLAM tells its epoch any more, so that the rule for plain ones is used."""
        self._told.pop(robot, None)

    def publisher(self, robot: str, start: str) -> None:
        """Note who publishes a robot's map: a word that no other publisher has."""
        self._publishers[robot] = start

    def forget(self, robot: str) -> None:
        """Forget a robot that is gone."""
        for record in (self._told, self._first, self._publishers, self._named, self._last):
            record.pop(robot, None)

    def changed(self, now: float) -> list[tuple[str, Epoch, bool]]:
        """
        Return robots whose map has another publisher than it had, with the epoch that began.

        The last word is whether the map that came last is of it already.
        """
        found = []
        for robot, epoch in list(self._named.items()):
            start = self._publishers.get(robot, epoch.start)
            if start != epoch.start and robot not in self._told:
                self._named[robot] = Epoch(start)
                _, came = self._last.get(robot, (None, float('-inf')))
                fresh = (epoch.start == UNKNOWN     # it is the first publisher that is noticed
                         or now - came < TUNING.fresh)
                found.append((robot, Epoch(start), fresh))
        return found

    def epoch(self, robot: str, loaded: Loaded, grid: Grid, now: float) -> Epoch | None:
        """Return the epoch of a map that came; None while it waits for a word on what it is."""
        told = self._told.get(robot)
        if told is not None:
            return told[0] if loaded == told[1] else None
        if now - self._first.setdefault(robot, now) < TUNING.patience:
            return None
        epoch = self._named.get(robot, Epoch(self._publishers.get(robot, UNKNOWN)))
        last = self._last.get(robot)
        if last is not None and begun_anew(last[0], grid):
            epoch = epoch._replace(reset=epoch.reset + 1)
        self._named[robot], self._last[robot] = epoch, (grid, now)
        return epoch
