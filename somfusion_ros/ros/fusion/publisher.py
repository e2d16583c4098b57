# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a fusion node publishes about the team, but for TF."""

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
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.diagnostics import diagnostic_array
from somfusion_ros.ros.fusion.frames import Frames
from somfusion_ros.ros.fusion.markers import matched_clusters, team_markers
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.screening import outline
from somfusion_ros.team.snapshot import Snapshot
from visualization_msgs.msg import MarkerArray


class FusionPublisher:
    """The publishers of one robot's fusion node; prefix: where its topics for the team stand."""

    def __init__(self, node: Any, frames: Frames, prefix: str, merged_map_topic: str) -> None:
        self._node, self._frames = node, frames
        self._map = node.create_publisher(OccupancyGrid, merged_map_topic, qos.LATCHED)
        self._graded = node.create_publisher(
            OccupancyGrid, f'{merged_map_topic}{names.GRADED_SUFFIX}', qos.LATCHED)
        self._shown: tuple[OccupancyGrid, Grid] | None = None
        self._relative_topic = f'{prefix}{names.RELATIVE_TRANSFORMS}'
        self._relative = self._relative_publisher()
        self._told: set[str] = set()
        self._poses_told = self._bodies_told = False
        self._bodies = node.create_publisher(PoseArray, names.PEER_BODIES, qos.LATEST)
        self._pose_publishers: dict[str, Any] = {}
        self._poses = node.create_publisher(PoseArray, names.PEER_POSES, qos.STREAM)
        self._lookouts = node.create_publisher(PoseArray, names.LOOKOUTS, qos.LATCHED)
        self._shown_lookouts: list[Pose] = []
        self._clusters = node.create_publisher(PointCloud2, f'{prefix}{names.CLUSTERS}',
                                               qos.LATCHED)
        self._markers = node.create_publisher(MarkerArray, names.MARKERS, qos.LATEST)
        self._diagnostics = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.STREAM)

    def _relative_publisher(self) -> Any:
        """Make the publisher of accepted transforms, which repeats them to late joiners."""
        return self._node.create_publisher(TransformStamped, self._relative_topic,
                                           qos.LATCHED_PER_PAIR)

    def global_map(self, grid: Grid) -> None:
        """Publish a new global map."""
        self._shown = convert.grid_message(grid, self._frames.world, self._now()), grid
        self.repeat_global_map()

    def repeat_global_map(self) -> None:
        """Publish the global map again, for those who came late and take no latched message."""
        if self._shown is None:
            return
        message, grid = self._shown
        self._map.publish(message)
        if self._graded.get_subscription_count():
            self._graded.publish(convert.grid_message(
                grid, message.header.frame_id, message.header.stamp, graded=True))

    def team(self, snapshot: Snapshot, heard: Mapping[str, Heard],
             present: Collection[str]) -> None:
        """Publish which transforms the robot itself accepted, and where those present are."""
        stamp, world = self._now(), snapshot.world(self._frames.robot)
        own = self._frames.map_of(self._frames.robot)
        if self._told - snapshot.own_transforms.keys():   # a late joiner must not hear these
            self._node.destroy_publisher(self._relative)
            self._relative = self._relative_publisher()
        self._told = set(snapshot.own_transforms)
        for peer, pose in snapshot.own_transforms.items():
            self._relative.publish(convert.transform_message(
                pose, own, self._frames.map_of(peer), stamp))
        lookouts = snapshot.lookouts(self._frames.robot)
        if lookouts != self._shown_lookouts:
            self._shown_lookouts = lookouts
            self._lookouts.publish(convert.pose_array(lookouts, self._frames.own, stamp))
        newest = {robot: tuple(heard[robot].poses)[-1:] for robot in sorted(world)
                  if robot in heard and robot in {self._frames.robot, *present}}
        self._team_poses({robot: last for robot, poses in newest.items() for last in poses},
                         snapshot, stamp)

    def _team_poses(self, here: Mapping[str, TimedPose], snapshot: Snapshot, stamp: Time) -> None:
        """Publish where the robots are: all in one message, and each with its covariance."""
        own, frame = self._frames.robot, self._frames.world
        world, covariances = snapshot.world(own), snapshot.covariances(own)
        poses = {robot: Pose.from_array(compose(world[robot], item.pose))
                 for robot, item in here.items()}
        if poses or self._poses_told:
            self._poses_told = bool(poses)     # none is told once, so that the last one goes
            self._poses.publish(convert.pose_array(poses.values(), frame, stamp))
        others = [between(world[own], pose) for robot, pose in poses.items()
                  if robot in snapshot.own_transforms]
        if others or self._bodies_told:
            self._bodies_told = bool(others)
            self._bodies.publish(convert.pose_array(map(Pose.from_array, others),
                                                    self._frames.own, stamp))
        for robot, pose in poses.items():
            by_map, by_pose = compose_jacobians(world[robot], here[robot].pose)
            P = (by_map @ covariances[robot] @ by_map.T
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
        stamp, frame = self._now(), self._frames.own
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
