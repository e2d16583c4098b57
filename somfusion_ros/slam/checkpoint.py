# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a later run goes on from, and the graph that it is a copy of."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.chains import Chains
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.map_scans import MapScan, MapScans
from somfusion_ros.slam.mapping import place
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.tracker_state import TrackerState
from somfusion_ros.slam.trail import Trail

NOTHING = Cloud(np.zeros((0, 2)), np.zeros((0, 2)))   # what a hidden view shows
FAR = np.full(2, 1e9)   # [m] centre of a hidden view, so that no loop is sought with it


@dataclass
class ViewGraph:
    """
    The views of one map, and everything that hangs on them.

    The filter over n views, with the views' clouds, the centres (2,) of these, and their stamps
    [s]; the constraints in the order in which the filter took them; the scans kept for the map;
    the trail; the views whose loops are still to be closed; which map it is; the views that show
    nothing any more.
    """

    ekf: DelayedStateEkf = field(default_factory=DelayedStateEkf)
    clouds: list[Cloud] = field(default_factory=list)
    centres: list[Array] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    scans: MapScans = field(default_factory=MapScans)
    trail: Trail = field(default_factory=Trail)
    to_close: deque[int] = field(default_factory=deque)
    epoch: Epoch = Epoch()
    hidden: set[int] = field(default_factory=set)

    def add(self, link: Constraint, seen: Cloud, stamp: float) -> int:
        """Append a view that hangs on another, with what it saw at a stamp [s]; return it."""
        new = self.ekf.augment(link.z, link.R, link.first)
        if new:
            self.constraints.append(link)
        self.clouds.append(seen)
        self.centres.append(centre(seen))
        self.stamps.append(stamp)
        self.to_close.append(new)
        return new

    def hide(self, views: Iterable[int]) -> None:
        """Let views show nothing any more; they keep their place among the others."""
        for view in views:
            self.clouds[view], self.centres[view] = NOTHING, FAR
            self.hidden.add(view)

    def replace(self, views: Iterable[int]) -> None:
        """Let views show nothing but what is drawn of them: newer ones took their place."""
        for view in views:
            drawn = self.clouds[view].outline
            self.hide([view])
            self.clouds[view] = Cloud(NOTHING.points, NOTHING.normals, drawn)

    def showing(self) -> NDArray[np.bool_]:
        """Return which views (n,) show what they saw."""
        showing = np.ones(self.ekf.n, bool)
        showing[list(self.hidden)] = False
        return showing

    def join(self, piece: 'ViewGraph', link: Constraint) -> None:
        """Append the views of another graph, of which the first hangs on a constraint."""
        first = self.ekf.n
        self.ekf.augment(link.z, link.R, link.first)
        self.constraints.append(link)
        for c in piece.constraints:
            moved = Constraint(c.first + first, c.second + first, c.z, c.R)
            if moved.second == self.ekf.n:
                self.ekf.augment(c.z, c.R, moved.first)
            else:
                self.ekf.update(moved)
            self.constraints.append(moved)
        self.clouds += piece.clouds
        self.centres += piece.centres
        self.stamps += piece.stamps
        self.hidden |= {view + first for view in piece.hidden}
        scans = [replace(scan, view=scan.view + first) for scan in piece.scans]
        self.scans.extend(scans, place(scans, self.ekf.poses))
        for stamp, view, pose in zip(piece.trail.stamps, piece.trail.views, piece.trail.poses,
                                     strict=True):
            self.trail.append(float(stamp), int(view) + first, pose)
        self.to_close.extend(view + first for view in piece.to_close)

    def local_map(self, view: int, around: Sequence[int]) -> LocalMap:
        """Join what views saw, in the frame of one of them."""
        poses = self.ekf.poses
        return LocalMap.of_views([self.clouds[k] for k in around],
                                 list(between(poses[view], poses[list(around)])))

    @property
    def chains(self) -> Chains:
        """The chains of the views there are now; the lock must be held."""
        return Chains(self.ekf.begins, self.ekf.n)

    def chain(self, view: int) -> range:
        """Return the views that follow one another, with a view among them."""
        return self.chains.of(view)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """
    What a later run can go on from.

    poses (n, 3), stamps (n,) [s] and clouds of the views; the constraints, by age, from which
    their covariance follows; the scans kept for the map; the trail (m, 5): see `Trail`; the views
    whose loops are to be closed; the view that the robot was tracked from, and the tracker's
    state; which map it is. The views that a scan is matched against, and those that were added
    of late: none in a file of an earlier version. closed: whether nothing was told of the map
    after this.
    """

    poses: Array
    stamps: Array
    clouds: Sequence[Cloud]
    constraints: Sequence[Constraint]
    scans: Sequence[MapScan]
    trail: Array
    to_close: Sequence[int]
    view: int
    tracker: TrackerState
    epoch: Epoch = Epoch()
    around: Sequence[int] = ()
    fresh: Sequence[int] = ()
    closed: bool = False

    @classmethod
    def of(cls, graph: ViewGraph, view: int, tracker: TrackerState, around: Sequence[int] = (),
           fresh: Iterable[int] = ()) -> 'Checkpoint':
        """Copy what is appended to; records and clouds themselves never change."""
        return cls(graph.ekf.poses.copy(), np.array(graph.stamps), tuple(graph.clouds),
                   tuple(graph.constraints), graph.scans.copy(), graph.trail.rows,
                   tuple(graph.to_close), view, tracker, graph.epoch, tuple(around),
                   tuple(fresh))

    def epoch_in(self, program: Epoch, fixed: bool) -> Epoch:
        """
        Return the epoch of the map as another program goes on with it.

        It began with that program where it was made offline, and went back where more may have
        been told of it; a fixed map does not change.
        """
        if not self.epoch.start:
            return program
        return self.epoch if self.closed or fixed else self.epoch.gone_back(program.start)

    def graph(self) -> ViewGraph:
        """Return a graph to go on with: every constraint is fused again, in order."""
        ekf, scans = DelayedStateEkf.of(self.poses, self.constraints), MapScans()
        scans.extend(self.scans, place(self.scans, self.poses))
        scans.resume()
        graph = ViewGraph(ekf, list(self.clouds), [centre(cloud) for cloud in self.clouds],
                          self.stamps.tolist(), list(self.constraints), scans, Trail(self.trail),
                          deque(self.to_close), self.epoch)
        graph.replace([k for k, cloud in enumerate(self.clouds) if not len(cloud)])
        return graph
