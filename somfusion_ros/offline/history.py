# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How one robot's SLAM went: where it took the robot to be, and its map from time to time."""

from dataclasses import dataclass, field

import numpy as np
from somfusion_ros.geometry import between, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step


@dataclass
class History:
    """
    What a live slam_node would have published.

    A map is kept every `period` [s] of the log's time, with the path of the views (n, 3) then.
    """

    period: float
    steps: list[Step] = field(default_factory=list)
    maps: list[tuple[float, Grid, np.ndarray]] = field(default_factory=list)

    def add(self, step: Step, slam: Slam) -> None:
        """Record one step, and the map if it is time to."""
        if not step.accepted:
            return
        self.steps.append(step)
        if not self.maps or step.stamp >= self.maps[-1][0] + self.period:
            self.end(slam)

    def end(self, slam: Slam) -> None:
        """Record the map as it is now."""
        if self.steps:
            self.maps.append((self.steps[-1].stamp, slam.grid(), slam.views()[1]))

    def span(self) -> tuple[float, float]:
        """Return first and last stamp [s]."""
        return self.steps[0].stamp, self.steps[-1].stamp

    def map_at(self, stamp: float) -> Grid | None:
        """Return the newest map at a stamp [s]."""
        return next((grid for t, grid, _ in reversed(self.maps) if t <= stamp), None)

    @staticmethod
    def T_odom_base(step: Step) -> Pose:
        """Return the odometry that a step was made with."""
        return Pose.from_array(between(step.T_map_odom, step.pose))
