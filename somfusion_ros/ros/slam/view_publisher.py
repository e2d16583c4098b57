# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a slam_node tells of its path, so that a team can bend its maps together: `views`."""

from array import array
from typing import Any
from uuid import uuid4

from somfusion_ros.ros.common import names, qos
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.slam import Slam
from somfusion_ros.team.teller import Teller
from somfusion_ros.team.view_store import encode_batches
from std_msgs.msg import UInt8MultiArray


TOLD_AT_ONCE = 100   # views: 0.3 s of work


class ViewPublisher:
    """Publishes what of the path was not told yet; of another map all is told anew."""

    def __init__(self, node: Any) -> None:
        self._topic = node.create_publisher(UInt8MultiArray, names.VIEWS, qos.LOG)
        self._epoch: Epoch | None = None
        self._told: tuple[Teller, str]

    def publish(self, slam: Slam) -> bool:
        """Tell some of what is new; return whether there is more."""
        path = slam.checkpoint()
        if path.epoch != self._epoch:
            self._epoch, self._told = path.epoch, (Teller(), uuid4().hex[:6])
        teller, telling = self._told
        for batch in encode_batches(path.epoch, telling, teller.more(path, TOLD_AT_ONCE)):
            block = array('B')
            block.frombytes(batch)
            self._topic.publish(UInt8MultiArray(data=block))
        return teller.views < len(path.clouds)
