# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Everything a fusion node publishes, and the names of the frames it does so in."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.geometry import between, compose, compose_jacobians, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.cluster_rows import cluster_rows
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.diagnostics import diagnostic_array
from somfusion_ros.ros.common.tf import Broadcaster
from somfusion_ros.ros.fusion.markers import matched_clusters, team_markers
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.screening import outline
from somfusion_ros.team.session import Snapshot
from visualization_msgs.msg import MarkerArray


class FusionPublisher:
    """The publishers of one robot's fusion node."""

    def __init__(self, node: Any, robot: str, config: FusionNodeConfig) -> None:
        self._node, self._robot, self._config = node, robot, config
        self._transforms = Broadcaster(node)
        self._map = node.create_publisher(OccupancyGrid, config.merged_map_topic, qos.LATCHED)
        self._relative = node.create_publisher(TransformStamped, names.RELATIVE_TRANSFORMS,
                                               qos.LATCHED_PER_PAIR)
        self._bodies = node.create_publisher(PoseArray, names.PEER_BODIES, qos.LATEST)
        self._pose_publishers: dict[str, Any] = {}
        self._poses = node.create_publisher(PoseArray, names.PEER_POSES, qos.STREAM)
        self._clusters = node.create_publisher(PointCloud2, names.CLUSTERS, qos.LATCHED)
        self._markers = node.create_publisher(MarkerArray, names.MARKERS, qos.LATEST)
        self._diagnostics = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.STREAM)

    def frame(self, robot: str) -> str:
        """Name of a robot's map frame in this robot's tree."""
        own = self._config.map_frame
        return own if robot == self._robot else f'{robot}/{own.rpartition("/")[2]}'

    @property
    def _shared_tree(self) -> bool:
        """Whether all robots share one /tf: a prefixed map frame would be pointless elsewhere."""
        return '/' in self._config.map_frame.strip('/')

    def global_map(self, grid: Grid) -> None:
        """Publish the global map."""
        self._map.publish(convert.grid_message(grid, self._config.world_frame, self._now()))

    def transforms(self, snapshot: Snapshot, heard: Mapping[str, Heard],
                   alive: Collection[str]) -> None:
        """
        Repeat what is accepted, as messages and on TF, and where the robots are.

        In one tree for all robots, a peer whose own fusion node is alive places its map itself.
        """
        stamp, world = self._now(), snapshot.world(self._robot)
        for peer, pose in snapshot.own_transforms.items():
            self._relative.publish(convert.transform_message(
                pose, self.frame(self._robot), self.frame(peer), stamp))
        self._transforms.send([convert.transform_message(
            pose, self._config.world_frame, self.frame(robot), stamp)
            for robot, pose in world.items()
            if robot == self._robot or not self._shared_tree or robot not in alive])
        self._team_poses({robot: heard[robot].poses[-1] for robot in sorted(world)
                          if robot in heard and heard[robot].poses}, snapshot, stamp)

    def _team_poses(self, here: Mapping[str, TimedPose], snapshot: Snapshot, stamp: Time) -> None:
        """Publish where the robots are: all in one message, and each with its covariance."""
        world, frame = snapshot.world(self._robot), self._config.world_frame
        poses = {robot: Pose.from_array(compose(world[robot], item.pose))
                 for robot, item in here.items()}
        if poses:
            self._poses.publish(convert.pose_array(poses.values(), frame, stamp))
        others = [between(world[self._robot], pose) for robot, pose in poses.items()
                  if robot != self._robot]
        if others:
            self._bodies.publish(convert.pose_array(map(Pose.from_array, others),
                                                    self._config.map_frame, stamp))
        for robot, pose in poses.items():
            by_map, by_pose = compose_jacobians(world[robot], here[robot].pose)
            P = (by_map @ snapshot.solution.covariances[robot] @ by_map.T
                 + by_pose @ here[robot].covariance @ by_pose.T)
            self._pose_of(robot).publish(convert.pose_with_covariance(pose, P, frame, stamp))

    def _pose_of(self, robot: str) -> Any:
        """Return the publisher of one robot's pose."""
        if robot not in self._pose_publishers:
            self._pose_publishers[robot] = self._node.create_publisher(
                PoseWithCovarianceStamped, f'{names.PEER_POSES}/{robot}', qos.STREAM)
        return self._pose_publishers[robot]

    def learned(self, learned: LearnedMap, peers: Iterable[tuple[LearnedMap, Pose]]) -> None:
        """
        Publish the clusters of the robot's own map, and markers where somebody looks.

        Markers show the matches with peers' maps that lie at T_own_peer.
        """
        stamp, frame = self._now(), self.frame(self._robot)
        self._clusters.publish(convert.cluster_cloud(cluster_rows(outline(learned)), frame, stamp))
        if self._markers.get_subscription_count():
            matches = [matched_clusters(learned, *peer) for peer in peers]
            self._markers.publish(team_markers(learned, frame, stamp, np.concatenate(
                [np.empty((0, 2, 2)), *matches])))

    def diagnostics(self, statuses: Iterable[DiagnosticStatus]) -> None:
        """Publish statuses."""
        self._diagnostics.publish(diagnostic_array(self._now(), list(statuses)))

    def _now(self) -> Time:
        """Return the node's time."""
        return self._node.get_clock().now().to_msg()
