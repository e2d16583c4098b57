# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot has not told of its path yet."""

from collections import Counter
from dataclasses import dataclass
from weakref import WeakSet

import numpy as np
from somfusion_ros.geometry import Array, compose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import Place, place_of
from somfusion_ros.team.beam_code import encode_beams
from somfusion_ros.team.compact import pack
from somfusion_ros.team.view_facts import encode_constraint, encode_scan, Facts, ViewFact
from somfusion_ros.team.view_set import DrawnScan


@dataclass(frozen=True)
class TellerTuning:
    """Which scans between views are told."""

    spacing: float = tuned(0.2, 'm, rad', 'between scans that are told to be drawn: at 0.1 they '
                           'cost twice as much, without any the map knows up to a third less',
                           'mines, wean, Intel and CSAIL')
    per_place: int = tuned(2, 'scans', 'between views that are told of one place: whoever comes '
                           'again and again tells views only', 'Intel, wean')


TUNING = TellerTuning()


class Teller:
    """Tells of a robot's path what it has not told yet."""

    def __init__(self) -> None:
        self._views = self._constraints = self._steps = self._rows = 0
        self._told: WeakSet[Outline] = WeakSet()
        self._last: tuple[int, Array] = -1, np.zeros(3)
        self._places: Counter[Place] = Counter()
        self._empty: set[int] = set()      # views that were taken back

    def more(self, path: Checkpoint) -> Facts:
        """Return the facts of a path that are new."""
        steps, loops = {}, []
        for constraint in path.constraints[self._constraints:]:
            if constraint.second == self._steps + 1:     # the first that leads to a view
                self._steps += 1
                steps[constraint.second] = constraint
            else:
                loops.append(encode_constraint(constraint))
        taken_back = self._taken_back(path)
        views = []
        for k in range(self._views, len(path.clouds)):
            outline = path.clouds[k].outline
            self._told.add(outline)
            views.append(ViewFact(k, float(path.stamps[k]), path.poses[k], encode_beams(outline),
                                  steps.get(k)).encode())
        between = [encode_scan(scan) for scan in self._fresh(path)]
        self._views, self._constraints = len(path.clouds), len(path.constraints)
        return Facts(tuple(views), tuple(loops), tuple(between), taken_back)

    def _taken_back(self, path: Checkpoint) -> tuple[bytes, ...]:
        """Tell of views that were told and show nothing any more."""
        empty = {k for k in range(min(self._views, len(path.clouds)))
                 if not len(path.clouds[k].outline.reach)}
        fresh = sorted(empty - self._empty)
        self._empty = empty
        return (pack((fresh[0], fresh[-1] - fresh[0] + 1)),) if fresh else ()

    def _fresh(self, path: Checkpoint) -> list[DrawnScan]:
        """Choose scans that are new, spaced from one another and from the view they hang on."""
        rows = path.trail[min(self._rows, len(path.trail)):]
        stamps = {(int(row[1]), *row[2:]): float(row[0]) for row in rows}
        self._rows = len(path.trail)
        chosen = []
        for scan in path.scans:
            if scan.outline in self._told:
                continue
            self._told.add(scan.outline)
            view, last = self._last
            x, y, theta = scan.T_view_base - (last if view == scan.view else np.zeros(3))
            stamp = stamps.get((scan.view, *scan.T_view_base))
            if stamp is None or max(np.hypot(x, y), abs(wrap(theta))) < TUNING.spacing:
                continue
            self._last = scan.view, scan.T_view_base
            place = place_of(compose(path.poses[scan.view], scan.T_view_base))
            self._places[place] += 1
            if self._places[place] <= TUNING.per_place:
                chosen.append(DrawnScan(stamp, scan.view, scan.T_view_base, scan.outline))
        return chosen


def tell(path: Checkpoint) -> Facts:
    """Tell of a robot's path all at once."""
    return Teller().more(path)
