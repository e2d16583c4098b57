# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages of the robot itself and of its peers into the inbox, with what reads each kind.

Maps, states and clusters are read by the worker, when it gets to them; poses at once.
"""

from collections.abc import Callable
import time

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common.map_epoch import MapEpoch
from somfusion_ros.ros.common.peers import robot_of
from somfusion_ros.ros.fusion.team_messages import bytes_from_message, clusters_from_message
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CLUSTERS, MAP, PLAIN_MAP, STATE
from somfusion_ros.team.heard import TimedPose
from somfusion_ros.team.inbox import Inbox, TimedClusters
from somfusion_ros.team.lent_map import lent_map
from somfusion_ros.team.map_codec import HEADER, number_of
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.plain_epochs import PlainMap
from somfusion_ros.team.sightings import Sighting, Sightings
from somfusion_ros.team.state_codec import decode_state
from std_msgs.msg import String, UInt8MultiArray

SECOND = 10 ** 9   # [ns]


class Receiver:
    """Callbacks of all subscriptions, each but the first argument bound by who subscribes."""

    def __init__(self, inbox: Inbox, sightings: Sightings, max_cells: int,
                 count: Callable[..., None]) -> None:
        self.inbox = inbox
        self._sightings, self._count = sightings, count
        self._max_cells = max_cells

    def on_map(self, robot: str, message: OccupancyGrid) -> None:
        """Keep a whole map."""
        self.inbox.keep(robot, PLAIN_MAP, message, len(message.data), self._read_map)

    def on_epoch(self, robot: str, message: String) -> None:
        """Note which map a robot's SLAM publishes."""
        try:
            epoch, loaded = MapEpoch.from_message(message)
        except ValueError as error:
            self._count(f'map_epoch_of_{robot}_unusable', str(error))
            return
        self.inbox.plain.tell(robot, epoch, (loaded.sec, loaded.nanosec))

    def on_bytes(self, robot: str, message: UInt8MultiArray, channel: str) -> None:
        """Keep a part of the stream of a map."""
        self.inbox.keep(robot, channel, message, len(message.data), bytes_from_message,
                        number_of(bytes(message.data[:HEADER.size])))

    def on_lent_map(self, robot: str, message: UInt8MultiArray) -> None:
        """Keep the map of a robot that is gone, as another one hands it on."""
        self.inbox.keep(robot, MAP, message, len(message.data),
                        lambda lent: lent_map(bytes_from_message(lent)))

    def on_state(self, robot: str, message: String) -> None:
        """Keep what a peer accepts."""
        self.inbox.keep(robot, STATE, message, len(message.data),
                        lambda state: decode_state(state.data))

    def on_clusters(self, robot: str, message: PointCloud2) -> None:
        """Keep the clusters of a peer's map."""
        self.inbox.keep(robot, CLUSTERS, message, len(message.data), _read_clusters)

    def on_path(self, message: Path) -> None:
        """Keep the robot's own path."""
        self.inbox.keep_path([(p.pose.position.x, p.pose.position.y) for p in message.poses])

    def on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        """Accept a robot's pose in the map that its SLAM publishes."""
        self.inbox.keep_pose(robot, lambda: (_timed_pose(message), None))

    def on_team_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        """Accept a robot's pose in the map that its frame names."""
        self.inbox.keep_pose(robot, lambda: (
            _timed_pose(message), Epoch.parse(message.header.frame_id.rpartition('@')[2])))

    def on_transform(self, owner: str, message: TransformStamped) -> None:
        """Keep a pair that a robot without a state accepted; nobody tells how well it is known."""
        self.inbox.keep_transform(owner, robot_of(message.child_frame_id), message,
                                  _transform_of_unknown_quality)

    def on_sighting(self, message: PoseWithCovarianceStamped) -> None:
        """Keep a sighting: header.frame_id names the peer, the pose is in the own base frame."""
        try:
            self._sightings.add(Sighting(
                robot_name(message.header.frame_id.strip('/')),
                convert.seconds(message.header.stamp),
                convert.pose_from_message(message.pose.pose),
                convert.usable_covariance(message.pose.covariance), time.monotonic()))
        except ValueError as error:
            self._count('encounters_unusable', str(error))

    def _read_map(self, message: OccupancyGrid) -> PlainMap:
        """Read a whole map."""
        loaded = message.info.map_load_time
        return PlainMap(convert.cells_from_message(message, self._max_cells),
                        (loaded.sec, loaded.nanosec))


def _read_clusters(message: PointCloud2) -> TimedClusters:
    """Read the clusters of a map."""
    stamp = message.header.stamp
    return TimedClusters(clusters_from_message(message), stamp.sec * SECOND + stamp.nanosec)


def _timed_pose(message: PoseWithCovarianceStamped) -> TimedPose:
    """Read a pose; ValueError where it is none."""
    return TimedPose(convert.seconds(message.header.stamp),
                     convert.pose_from_message(message.pose.pose),
                     convert.usable_covariance(message.pose.covariance))


def _transform_of_unknown_quality(message: TransformStamped) -> tuple[Pose, Array]:
    """Return the pose of the child frame, with the covariance of what nobody told."""
    return convert.transform_from_message(message), convert.usable_covariance(np.zeros(36))
