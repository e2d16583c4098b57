# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All that one robot's SLAM holds: the filter, what it was made of, and what was seen."""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.mapping import MapScan
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.tracker_state import TrackerState


@dataclass
class ViewGraph:
    """
    The views of one map, and everything that hangs on them.

    The filter over n views, with the views' clouds, the centres (2,) of these, and their stamps
    [s]; the constraints in the order in which the filter took them; the scans kept for the map;
    the track: stamp [s], view, T_view_base (3,) of every scan used; the views whose loops are
    still to be closed; which map it is.
    """

    ekf: DelayedStateEkf = field(default_factory=DelayedStateEkf)
    clouds: list[Cloud] = field(default_factory=list)
    centres: list[Array] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    scans: list[MapScan] = field(default_factory=list)
    track: list[tuple[float, int, Array]] = field(default_factory=list)
    to_close: deque[int] = field(default_factory=deque)
    epoch: Epoch = Epoch()


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """
    What a later run can go on from.

    A copy of the graph but for the filter, whose mean is poses (n, 3) and whose covariance
    follows from the constraints; and the tracker's state.
    """

    graph: ViewGraph
    poses: Array
    tracker: TrackerState

    @classmethod
    def of(cls, graph: ViewGraph, tracker: TrackerState) -> 'Checkpoint':
        """Copy what is appended to; records and clouds themselves never change."""
        g = graph
        copied = ViewGraph(DelayedStateEkf(), list(g.clouds), list(g.centres), list(g.stamps),
                           list(g.constraints), list(g.scans), list(g.track), deque(g.to_close),
                           g.epoch)
        return cls(copied, g.ekf.poses.copy(), tracker)

    def resumed(self) -> ViewGraph:
        """Return a graph to go on with: every constraint passes the filter again, in order."""
        ekf, graph = DelayedStateEkf(), replace(self.graph)
        ekf.augment(np.zeros(3), np.zeros((3, 3)))
        for constraint in graph.constraints:
            if constraint.second == ekf.n:
                ekf.augment(constraint.z, constraint.R, constraint.first)
            else:
                ekf.update(constraint)
        ekf.relinearise(self.poses)
        graph.ekf = ekf
        return graph
