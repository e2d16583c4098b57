# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tracker goes on from after a restart, as a record and as arrays by name."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.motion import Odometry

SHAPES = {'T_view_base': (3,), 'P': (3, 3), 'velocity': (3,), 'odometry': (7,), 'dt': (),
          'unseen': (), 'usual': (), 'lost': (), 'turning': (3,), 'P_turning': (3, 3),
          'travelling': (1,), 'P_travelling': (1, 1), 'scale': (2, 3)}


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackerState:
    """
    The numbers of a tracker, all but its local map.

    Pose T_view_base (3,) and its covariance P (3, 3); velocity (3,) per second; the odometry of
    the newest scan, None before the first; dt [s] between the two newest scans, unseen [s] since
    the last match, the usual inlier ratio, whether the tracker is lost; the calibration's turning
    (3,) and travelling (1,) with covariances; derivatives (2, 3) by the scale of the travel.
    """

    T_view_base: Array
    P: Array
    velocity: Array
    odometry: Odometry | None
    dt: float
    unseen: float
    usual: float
    lost: bool
    turning: Array
    P_turning: Array
    travelling: Array
    P_travelling: Array
    scale: Array

    def arrays(self) -> dict[str, Array]:
        """Return every number by name, as in SHAPES; the odometry is empty before the first."""
        every = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        o = self.odometry
        every['odometry'] = [] if o is None else [o.stamp, *o.pose, *o.twist]
        return {name: np.array(value, dtype=float) for name, value in every.items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> 'TrackerState':
        """Make a state of arrays by name; ValueError where they are others than `arrays` makes."""
        shapes = {name: value.shape for name, value in arrays.items()}
        if shapes != SHAPES and shapes != {**SHAPES, 'odometry': (0,)}:
            raise ValueError('its tracker is that of another version')
        every: dict[str, Any] = {name: array.copy() if array.ndim else float(array)
                                 for name, array in arrays.items()}
        o = every['odometry']
        every |= {'odometry': Odometry(float(o[0]), o[1:4], o[4:]) if len(o) else None,
                  'lost': bool(arrays['lost'])}
        return cls(**every)
