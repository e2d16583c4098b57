# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Other robots in a scan: they are no walls, and they are gone in a moment."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from somfusion_ros.geometry import apply, Array, compose
from somfusion_ros.slam.scan import Scan


@dataclass(frozen=True, eq=False)
class Bodies:
    """Places (N, 2) [m] of other robots in the map, and the radius [m] of a robot."""

    places: Array = field(default_factory=lambda: np.zeros((0, 2)))
    radius: float = 0.0

    def hide(self, scan: Scan, T_map_base: ArrayLike) -> Scan:
        """
        Leave out the returns of a scan that lie on a robot's body, as if they had failed (NaN).

        Parameters
        ----------
        scan : the scan
        T_map_base : pose of the robot when it took the scan
        """
        if not len(self.places) or self.radius <= 0.0 or scan.fault():
            return scan
        ranges = np.array(scan.ranges, dtype=float)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        returned = np.isfinite(ranges)
        beams = np.where(returned, ranges, 0.0)[:, None] * np.column_stack(
            [np.cos(angles), np.sin(angles)])
        ends = apply(compose(T_map_base, scan.T_base_laser), beams)
        away = np.hypot(*(ends[:, None] - self.places).T).min(0)
        ranges[returned & (away < self.radius)] = np.nan
        return replace(scan, ranges=ranges)
