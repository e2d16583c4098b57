# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Everything a slam_node publishes, in the frames of its parameters."""

import time
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid, Path
from somfusion_ros.grid import Grid
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.diagnostics import diagnostic_array
from somfusion_ros.ros.common.map_epoch import MapEpoch
from somfusion_ros.ros.common.tf import Broadcaster
from somfusion_ros.ros.slam.view_publisher import ViewPublisher
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step
from std_msgs.msg import String


class SlamPublisher:
    """The publishers of one robot's slam_node."""

    def __init__(self, node: Any, config: SlamNodeConfig) -> None:
        self._node, self._config = node, config
        self._transforms = Broadcaster(node)
        self._map = node.create_publisher(OccupancyGrid, names.MAP, qos.LATCHED)
        self._graded = node.create_publisher(OccupancyGrid, names.MAP_GRADED, qos.LATCHED)
        self._shown: tuple[OccupancyGrid, Grid]
        self._path_message: Path
        self._metadata = node.create_publisher(MapMetaData, names.MAP_METADATA, qos.LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, names.ROBOT_POSE,
                                           qos.STREAM)
        self._path = node.create_publisher(Path, names.PATH, qos.LATEST)
        self._diagnostics = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.STREAM)
        self._epoch_topic = node.create_publisher(String, names.MAP_EPOCH, qos.LATCHED)
        self._views = ViewPublisher(node)
        self._epoch: MapEpoch | None = None
        self.sends_transforms = (config.transform_publish_period > 0
                                 and self._transforms.available)

    def map_message(self, grid: Grid, slam: Slam, stamp: Time) -> OccupancyGrid:
        """Return the message of a map."""
        message = convert.grid_message(grid, self._config.map_frame, stamp)
        message.info.map_load_time = self.epoch(slam.epoch).loaded
        return message

    def grid(self, message: OccupancyGrid, grid: Grid, slam: Slam) -> None:
        """Publish a map, of which this is the message, its metadata and path."""
        stamps, poses = slam.views()
        self._path_message = convert.path_message(
            stamps, slam.bend.views(poses), self._config.map_frame, message.header.stamp)
        self._shown = message, grid
        self.repeat_map()

    def views(self, slam: Slam) -> bool:
        """Tell some of the views that were not told yet; return whether more are left."""
        return self._views.publish(slam)

    def epoch(self, epoch: Epoch) -> MapEpoch:
        """Publish which map all else speaks of, once it is another one; return the word on it."""
        if self._epoch is None or self._epoch.epoch != epoch:
            seconds, nanoseconds = divmod(time.time_ns(), 10 ** 9)
            self._epoch = MapEpoch(epoch, Time(sec=seconds, nanosec=nanoseconds))
            self._epoch_topic.publish(self._epoch.message())
        return self._epoch

    def repeat_map(self) -> None:
        """Publish the newest map again, for those who came late and take no latched message."""
        message, grid = self._shown
        self._map.publish(message)
        self._metadata.publish(message.info)
        self._path.publish(self._path_message)
        if self._graded.get_subscription_count():
            graded = convert.grid_message(grid, message.header.frame_id, message.header.stamp,
                                          graded=True)
            graded.info = message.info
            self._graded.publish(graded)

    def pose(self, step: Step, stamp: Time) -> None:
        """Publish where the robot is."""
        self._pose.publish(convert.pose_with_covariance(
            step.pose, step.covariance, self._config.map_frame, stamp))

    def transform(self, step: Step, stamp: Time) -> None:
        """Repeat map -> odom, dated ahead by the timeout, so that consumers need not wait."""
        ahead = convert.seconds(stamp) + self._config.transform_timeout
        self._transforms.send([convert.transform_message(
            step.T_map_odom, self._config.map_frame, self._config.odom_frame,
            convert.time_message(ahead))])

    def diagnostics(self, status: DiagnosticStatus) -> None:
        """Publish a status."""
        self._diagnostics.publish(diagnostic_array(
            self._node.get_clock().now().to_msg(), [status]))
