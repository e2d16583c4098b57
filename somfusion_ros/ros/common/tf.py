# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
TF: estimated transforms go out on /tf, the mount of the laser comes in on /tf_static.

Only the message type tf2_msgs is needed, which every ROS installation has but PyPI has not.
Without it the mount comes from the parameter `laser_pose`, and every transform is still
published as a message. Both topics are absolute, as everywhere in ROS: remap /tf to tf and
/tf_static to tf_static for a robot with a tree of its own.
"""

from typing import Any

from somfusion_ros.geometry import Pose
from somfusion_ros.io.frame_tree import FrameTree, Mount
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.optional_types import message_type


class Broadcaster:
    """Sends estimates on /tf, never on /tf_static, because they change; nothing without TF."""

    def __init__(self, node: Any) -> None:
        self._type = _transform_type(node)
        self.available = self._type is not None
        self._publisher = (node.create_publisher(self._type, names.TF, qos.TRANSFORMS)
                           if self.available else None)

    def send(self, transforms: list[Any]) -> None:
        """Broadcast geometry_msgs/TransformStamped."""
        if self._publisher is not None and transforms:
            self._publisher.publish(self._type(transforms=transforms))


class Mounts:
    """
    Where lasers sit on the robot.

    A mount given as a parameter, unless it is all zero, goes before TF. Fixed transforms that a
    robot repeats on /tf count as well; that topic is busy, so it is heard only until the mount is
    known.
    """

    def __init__(self, node: Any, given: Pose) -> None:
        self._given = None if given == Pose() else Mount(given)
        self._known: dict[tuple[str, str], Mount] = {}
        self._tree, self._node, self._repeated = FrameTree(), node, None
        kind = None if self._given else _transform_type(node)
        if kind is None:
            self._given = self._given or Mount(given)
            return
        node.create_subscription(kind, names.TF_STATIC, self._on_transforms, qos.STATIC_TRANSFORMS)
        self._repeated = node.create_subscription(kind, names.TF, self._on_transforms,
                                                  qos.TRANSFORMS)

    def find(self, base_frame: str, laser_frame: str) -> Mount | None:
        """Return a mount; None while TF does not know it, ValueError where it is tilted."""
        if self._given is not None:
            return self._given
        frames = (base_frame, laser_frame)
        if frames not in self._known:
            mount = self._tree.mount(base_frame, laser_frame)
            if mount is None:
                return None
            self._known[frames] = mount
            if self._repeated is not None:
                self._node.destroy_subscription(self._repeated)
                self._repeated = None
        return self._known[frames]

    def _on_transforms(self, message: Any) -> None:
        self._tree.add(message.transforms)


def _transform_type(node: Any) -> Any:
    """Return tf2_msgs/TFMessage; None, logged once, where it is not installed."""
    kind = message_type('tf2_msgs.msg', 'TFMessage')
    if kind is None:
        node.get_logger().info('running without TF (no tf2_msgs): transforms go out as messages',
                               once=True)
    return kind
