# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the team's problem has the robot's own views, which fusion_node tells on `joint_path`."""

from collections.abc import Callable
from typing import Any

from nav_msgs.msg import Path
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import pose_from_message, seconds


class JointPath:
    """Hands stamps (m,) [s] and poses (m, 3) on; use: takes them."""

    def __init__(self, node: Any, use: Callable[[Array, Array], None],
                 count: Callable[..., None]) -> None:
        self._use, self._count = use, count
        node.create_subscription(Path, names.JOINT_PATH, self._on_path, qos.LATCHED)

    def _on_path(self, message: Path) -> None:
        """Take a path; one that is not usable is counted."""
        try:
            poses = np.array([pose_from_message(item.pose) for item in message.poses], float)
        except ValueError as error:
            self._count('joint_path_unusable', str(error))
            return
        self._use(np.array([seconds(item.header.stamp) for item in message.poses]),
                  poses.reshape(-1, 3))
