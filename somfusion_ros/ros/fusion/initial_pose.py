# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Translates poses given by hand in `world`, or in a peer's map, for the robot's own SLAM."""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from somfusion_ros.geometry import between, compose, Pose, rotation
from somfusion_ros.io.frame_names import plain
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.fusion.frames import Frames
from somfusion_ros.team.session import FusionSession


class InitialPose:
    """
    Hears `initialpose` and says it again in the frame of the robot's own map.

    RViz gives a pose in the viewer's fixed frame, which is `world` for who looks at the team; a
    SLAM knows its own map only.
    """

    def __init__(self, node: Any, frames: Frames, session: FusionSession,
                 count: Callable[..., None]) -> None:
        self._frames, self._session, self._count = frames, session, count
        self._again = node.create_publisher(PoseWithCovarianceStamped, names.INITIAL_POSE,
                                            qos.LATEST)
        node.create_subscription(PoseWithCovarianceStamped, names.INITIAL_POSE, self._on_pose,
                                 qos.LATEST)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Translate a pose unless it is in the own map already."""
        frame = plain(message.header.frame_id)
        if frame == plain(self._frames.own):
            return
        world = self._session.snapshot.world(self._frames.robot)
        placed = {self._frames.map_of(robot): pose for robot, pose in world.items()}
        placed[plain(self._frames.world)] = Pose()
        if frame not in placed:
            self._count('initialpose_frames', f'a pose in {frame!r} cannot be translated: that '
                        f'frame is not in {self._frames.world}')
            return
        try:
            pose = convert.pose_from_message(message.pose.pose)
            P = convert.planar_covariance(message.pose.covariance)
        except ValueError as error:
            self._count('initialpose_unusable', str(error))
            return
        T_map_frame = between(world[self._frames.robot], placed[frame])
        turn = np.eye(3)
        turn[:2, :2] = rotation(T_map_frame[2])
        self._again.publish(convert.pose_with_covariance(
            Pose.from_array(compose(T_map_frame, pose)), turn @ P @ turn.T, self._frames.own,
            message.header.stamp))
