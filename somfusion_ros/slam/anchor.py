# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where odometry that stalls and then catches up has the robot."""

from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.slam.calibration import Calibration
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.tracking_tuning import TUNING


class Anchor:
    """The last pose (3,) before odometry and matches differed, until they agree again."""

    def __init__(self) -> None:
        self._held: tuple[Odometry, Array] | None = None

    def hold(self, odometry: Odometry | None, pose: Array) -> None:
        """Remember the odometry at a pose (3,), unless an older one is held."""
        if self._held is None and odometry is not None:
            self._held = odometry, pose

    def drop(self) -> None:
        """Forget it: odometry and matches agree."""
        self._held = None

    def reframe(self, T_old_base: Array, T_new_base: Array) -> None:
        """See it from another view; the poses (3,) are those of the robot in both."""
        if self._held is not None:
            odometry, pose = self._held
            self._held = odometry, compose(T_new_base, between(T_old_base, pose))

    def reckoned(self, odometry: Odometry | None, calibration: Calibration) -> list[Array]:
        """Return the pose (3,) reckoned from it by odometry, as a list of one or none."""
        if (self._held is None or odometry is None
                or odometry.stamp - self._held[0].stamp > TUNING.catch_up):
            return []
        before, pose = self._held
        return [compose(pose, calibration.correct(between(before.pose, odometry.pose)))]
