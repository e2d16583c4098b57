# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The places of the other robots, which fusion_node publishes on `peer_bodies`."""

import time
from typing import Any

from geometry_msgs.msg import PoseArray
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import pose_from_message
from somfusion_ros.slam.bodies import Bodies

FORGOTTEN = 5.0   # [s] after which a place is too old to be used
MOST = 64         # robots that are looked for in one scan


class PeerBodies:
    """The newest places of the team's other robots in the robot's own map."""

    def __init__(self, node: Any, radius: float) -> None:
        self._radius = radius
        self._bodies: Array = np.empty((0, 2))
        self._heard = float('-inf')
        node.create_subscription(PoseArray, names.PEER_BODIES, self._on_bodies, qos.LATEST)

    def known(self) -> Bodies:
        """Return the bodies to leave out of a scan; nobody where nothing was heard of late."""
        forgotten = time.monotonic() - self._heard > FORGOTTEN
        return Bodies() if forgotten else Bodies(self._bodies, self._radius)

    def _on_bodies(self, message: PoseArray) -> None:
        """Keep the newest places; leave out those that are not finite."""
        found = []
        for pose in message.poses[:MOST]:
            try:
                found.append(pose_from_message(pose)[:2])
            except ValueError:
                continue
        self._bodies, self._heard = np.array(found).reshape(-1, 2), time.monotonic()
