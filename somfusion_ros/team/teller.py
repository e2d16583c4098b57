# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot has not told of its path yet."""

from dataclasses import dataclass, replace
from weakref import WeakSet

import numpy as np
from somfusion_ros.geometry import Array, compose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.team.beam_code import encode_beams
from somfusion_ros.team.fact import Fact, outline_of
from somfusion_ros.team.shown import Shown
from somfusion_ros.team.view_facts import (encode_constraint, encode_scan, encode_taken_back,
                                           Facts, ViewFact)
from somfusion_ros.team.view_set import DrawnScan


@dataclass(frozen=True)
class TellerTuning:
    """Which scans between views are told."""

    spacing: float = tuned(0.2, 'm, rad', 'between scans that are told to be drawn', 'mines, wean')


TUNING = TellerTuning()


class Teller:
    """Tells of a robot's path what it has not told yet; views: how many it told."""

    def __init__(self) -> None:
        self.views = self._constraints = self._steps = 0
        self._poses: list[Array] = []      # of the views as they were told
        self._told: WeakSet[Outline] = WeakSet()
        self._last: tuple[int, Array] = -1, np.zeros(3)
        self._shown = Shown()
        self._empty: set[int] = set()      # views that were taken back

    def more(self, path: Checkpoint, most: int | None = None) -> Facts:
        """Return the facts of a path that are new; of up to `most` views, the oldest."""
        if most is not None and len(path.clouds) > self.views + most:
            return self.more(self._up_to(path, self.views + most))
        steps, loops = {}, []
        for constraint in path.constraints[self._constraints:]:
            if constraint.second == self._steps + 1:     # the first that leads to a view
                self._steps += 1
                steps[constraint.second] = constraint
            else:
                loops.append(encode_constraint(constraint))
        taken_back = self._taken_back(path)
        views = []
        for k in range(self.views, len(path.clouds)):
            outline = path.clouds[k].outline
            self._told.add(outline)
            self._shown.add(outline, path.poses[k])
            beams, corners = encode_beams(outline)
            view = ViewFact(k, float(path.stamps[k]), np.zeros(3), steps.get(k), beams,
                            outline_of(corners)).told_at(path.poses[k], self._poses)
            self._poses.append(view.pose_after(self._poses))
            views.append(view.encode())
        between = [encode_scan(scan) for scan in self._fresh(path)]
        self.views, self._constraints = len(path.clouds), len(path.constraints)
        return Facts(tuple(views), tuple(loops), tuple(between), taken_back)

    def _up_to(self, path: Checkpoint, n: int) -> Checkpoint:
        """Return what a path was before its view n."""
        grown = (k for k in range(self._constraints, len(path.constraints))
                 if path.constraints[k].second >= n)
        return replace(path, clouds=path.clouds[:n],
                       constraints=path.constraints[:next(grown, len(path.constraints))],
                       scans=[scan for scan in path.scans if scan.view < n])

    def _taken_back(self, path: Checkpoint) -> tuple[Fact, ...]:
        """Tell of views that were told and show nothing any more: no view between two of them."""
        empty = {k for k in range(min(self.views, len(path.clouds)))
                 if not len(path.clouds[k].outline.reach)}
        fresh = np.array(sorted(empty - self._empty), int)
        self._empty = empty
        runs = np.split(fresh, np.flatnonzero(np.diff(fresh) > 1) + 1) if len(fresh) else []
        return tuple(encode_taken_back(range(int(run[0]), int(run[-1]) + 1)) for run in runs)

    def _fresh(self, path: Checkpoint) -> list[DrawnScan]:
        """Choose scans that show something new, spaced from one another and from their view."""
        fresh = [scan for scan in path.scans if scan.outline not in self._told]
        stamps = _stamps(path, {scan.view for scan in fresh})
        chosen = []
        for scan in fresh:
            self._told.add(scan.outline)
            view, last = self._last
            x, y, theta = scan.T_view_base - (last if view == scan.view else np.zeros(3))
            stamp = stamps.get(_key(scan.view, scan.T_view_base))
            if stamp is None or max(np.hypot(x, y), abs(wrap(theta))) < TUNING.spacing:
                continue
            pose = compose(path.poses[scan.view], scan.T_view_base)
            if not self._shown.is_new(scan.outline, pose):
                continue
            self._shown.add(scan.outline, pose)
            self._last = scan.view, scan.T_view_base
            chosen.append(DrawnScan(stamp, scan.view, scan.T_view_base, scan.outline))
        return chosen


def _stamps(path: Checkpoint, views: set[int]) -> dict[tuple[float, ...], float]:
    """Return the stamps [s] of the scans that hang on some views, by view and T_view_base."""
    rows = path.trail[np.isin(path.trail[:, 1], list(views))]
    return dict(zip([_key(int(row[1]), row[2:]) for row in rows], rows[:, 0].tolist(),
                    strict=True))


def _key(view: int, T_view_base: Array) -> tuple[float, ...]:
    """Return what tells a scan from others: the trail keeps poses in single precision."""
    return view, *T_view_base.astype(np.float32).tolist()


def tell(path: Checkpoint) -> Facts:
    """Tell of a robot's path all at once."""
    return Teller().more(path)
