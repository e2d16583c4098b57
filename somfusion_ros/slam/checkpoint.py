# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All that one robot's SLAM remembers: the filter, what it was made of, and what was seen."""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.constraint import Relation
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.mapping import MapScan
from somfusion_ros.slam.scan import Cloud


@dataclass
class Memory:
    """
    What the SLAM has been through.

    The filter over n views, with the views' clouds, the centres (2,) of these, and their stamps
    [s]; the relations in the order in which the filter took them; the scans kept for the map;
    the track: stamp [s], view, T_view_base (3,) of every scan used; the views whose loops are
    still to be closed.
    """

    ekf: DelayedStateEkf = field(default_factory=DelayedStateEkf)
    clouds: list[Cloud] = field(default_factory=list)
    centres: list[Array] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    scans: list[MapScan] = field(default_factory=list)
    track: list[tuple[float, int, Array]] = field(default_factory=list)
    to_close: deque[int] = field(default_factory=deque)


@dataclass(frozen=True, eq=False)
class State:
    """
    What a later run can go on from.

    A copy of the memory but for the filter, whose mean is poses (n, 3) and whose covariance
    follows from the relations; and the tracker's numbers by name.
    """

    memory: Memory
    poses: Array
    tracker: dict[str, Array]

    @classmethod
    def of(cls, memory: Memory, tracker: dict[str, Array]) -> 'State':
        """Copy what is appended to; records and clouds themselves never change."""
        m = memory
        copied = Memory(DelayedStateEkf(), list(m.clouds), list(m.centres), list(m.stamps),
                        list(m.relations), list(m.scans), list(m.track), deque(m.to_close))
        return cls(copied, m.ekf.poses.copy(), tracker)

    def resumed(self) -> Memory:
        """Give a memory to go on with: every relation passes the filter again, in order."""
        ekf, memory = DelayedStateEkf(), replace(self.memory)
        ekf.augment(np.zeros(3), np.zeros((3, 3)))
        for relation in memory.relations:
            if relation.second == ekf.n:
                ekf.augment(relation.z, relation.R)
            else:
                ekf.update(relation)
        ekf.relinearise(self.poses)
        memory.ekf = ekf
        return memory
