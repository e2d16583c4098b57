# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
TF where tf2_ros is installed, and a null object where it is not.

tf2_ros comes with a ROS installation and not from PyPI. Without it the mount of the laser comes
from the parameter `laser_pose`, and every transform is still published as a message.
"""

from importlib import import_module
from typing import Any, NamedTuple

from somfusion_ros.geometry import Pose
from somfusion_ros.ros.conversions import yaw


class Mount(NamedTuple):
    """Where a laser sits on the robot, and whether it hangs upside down."""

    T_base_laser: Pose
    upside_down: bool = False


class NoTransforms:
    """Stands in for TF: sends nothing, and every laser sits where the parameter says."""

    available = False

    def __init__(self, fallback: Pose) -> None:
        self._mount = Mount(fallback)

    def send(self, transforms: list[Any]) -> None:
        """Send nothing."""

    def mount(self, base_frame: str, laser_frame: str) -> Mount | None:
        """Give the mount of the parameter, whatever the frames are."""
        return self._mount


class Transforms:
    """Broadcasts estimated transforms and looks up the mount of the laser."""

    available = True

    def __init__(self, node: Any, tf2_ros: Any) -> None:
        self._time = import_module('rclpy.time').Time
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._broadcaster = tf2_ros.TransformBroadcaster(node)
        self._tf2_ros = tf2_ros

    def send(self, transforms: list[Any]) -> None:
        """Broadcast; on `tf`, never on `tf_static`, because estimates change."""
        if transforms:
            self._broadcaster.sendTransform(transforms)

    def mount(self, base_frame: str, laser_frame: str) -> Mount | None:
        """Look up the newest mount; None while TF does not know it."""
        try:
            found = self._buffer.lookup_transform(base_frame, laser_frame, self._time())
        except self._tf2_ros.TransformException:
            return None
        return planar_mount(found.transform)


def planar_mount(transform: Any) -> Mount:
    """Mount of a transform base <- laser; a laser whose z axis points down hangs upside down."""
    q = transform.rotation
    upside_down = 1.0 - 2.0 * (q.x ** 2 + q.y ** 2) < 0.0
    return Mount(Pose(transform.translation.x, transform.translation.y, yaw(q)),
                 upside_down)


def make_transforms(node: Any, fallback: Pose) -> NoTransforms | Transforms:
    """Use TF where tf2_ros can be imported; otherwise say so once and do without."""
    try:
        tf2_ros = import_module('tf2_ros')
    except ImportError as error:
        node.get_logger().info(f'running without TF ({error}): transforms go out as messages')
        return NoTransforms(fallback)
    return Transforms(node, tf2_ros)
