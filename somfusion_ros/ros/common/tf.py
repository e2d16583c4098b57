# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
TF: estimated transforms go out on /tf, the mount of the laser comes in on /tf_static.

Only the message type tf2_msgs is needed, which every ROS installation has but PyPI has not.
Without it the mount comes from the parameter `laser_pose`, and every transform is still
published as a message. Both topics are absolute, as everywhere in ROS: remap /tf to tf and
/tf_static to tf_static for a robot with a tree of its own.
"""

from collections.abc import Callable, Sequence
from typing import Any

from somfusion_ros.geometry import Pose
from somfusion_ros.io.frame_tree import FrameTree, Mount
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.optional_types import message_type


class Broadcaster:
    """Sends estimates on /tf, never on /tf_static, because they change; nothing without TF."""

    def __init__(self, node: Any) -> None:
        self._type = transform_type(node)
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

    A mount that is given goes before TF; without TF it sits at the base. Fixed transforms that a
    robot repeats on /tf count as well; that topic is busy, so it is heard only while a mount is
    wanted. A transform that is corrected later on /tf_static is taken from then on, and counted.
    """

    def __init__(self, node: Any, given: Sequence[float] | None,
                 count: Callable[..., None]) -> None:
        self._given = None if given is None else Mount(Pose.from_array(given))
        self._known: dict[tuple[str, str], Mount] = {}
        self._compared: set[tuple[str, str]] = set()   # with what TF says now
        self._tree, self._node, self._count = FrameTree(), node, count
        self._repeated: Any = None
        self._kind, self._robot = transform_type(node), node.get_namespace().strip('/')
        if self._kind is None:
            self._given = self._given or Mount(Pose())
            return
        node.create_subscription(self._kind, names.TF_STATIC, self._on_static,
                                 qos.STATIC_TRANSFORMS)
        if self._given is None:
            self._hear_repeated()

    def find(self, base_frame: str, laser_frame: str) -> Mount | None:
        """Return a mount; None while TF does not know it, ValueError where it is tilted."""
        frames = (base_frame, laser_frame)
        if self._given is not None:
            self._compare(frames, self._given)
            return self._given
        if frames not in self._known:
            mount = self._tree.mount(base_frame, laser_frame, self._robot)
            if mount is None:
                self._hear_repeated()   # another laser's is known already
                return None
            self._known[frames] = mount
            if self._repeated is not None:
                self._node.destroy_subscription(self._repeated)
                self._repeated = None
        return self._known[frames]

    def _compare(self, frames: tuple[str, str], given: Mount) -> None:
        """Count, for all that TF says anew, that a mount which is given is not the one there."""
        if frames in self._compared:
            return
        self._compared.add(frames)
        try:
            told = self._tree.mount(*frames, self._robot)
        except ValueError:   # tilted, which whoever gave a mount knows
            return
        odd = '' if told is None else given.difference(told, frames[1])
        if odd:
            self._count('mount_differs', odd)

    def _hear_repeated(self) -> None:
        """Listen to /tf, unless that is done already."""
        if self._repeated is None:
            self._repeated = self._node.create_subscription(
                self._kind, names.TF, self._on_repeated, qos.TRANSFORMS)

    def hint(self, base_frame: str, laser_frame: str) -> str:
        """Words on frames that are spelt like the laser's, '' where there are none."""
        alike = [] if self._given else self._tree.similar(base_frame, laser_frame, self._robot)
        return f' (there is one to {", ".join(alike)})' if alike else ''

    def _on_static(self, message: Any) -> None:
        """Keep fixed transforms; look mounts up anew where one was corrected."""
        before = len(self._tree.corrected)
        self._tree.add(message.transforms)
        self._compared.clear()
        if len(self._tree.corrected) > before:
            parent, child = self._tree.corrected[-1]
            self._count('mounts_corrected', f'{parent} -> {child} on /tf_static was corrected: '
                        'it is taken from now on')
            self._known.clear()

    def _on_repeated(self, message: Any) -> None:
        self._tree.add(message.transforms, static=False)


def transform_type(node: Any) -> Any:
    """Return tf2_msgs/TFMessage; None, logged once, where it is not installed."""
    kind = message_type('tf2_msgs.msg', 'TFMessage')
    if kind is None:
        node.get_logger().info('running without TF (no tf2_msgs): transforms go out as messages',
                               once=True)
    return kind
