# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a slam_node's odometry comes from: nav_msgs/Odometry, two wheels, or the tree of TF."""

from collections.abc import Callable
import time
from typing import Any

from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import Imu, JointState
from somfusion_ros.geometry import Array
from somfusion_ros.io.bags.odometry import TransformOdometry
from somfusion_ros.io.bags.transforms import best_odometry, pairs_of
from somfusion_ros.io.frame_names import bare, is_base, plain
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.tf import transform_type
from somfusion_ros.slam.wheel_odometry import WheelOdometry

PATIENCE = 2.0     # [s] for nav_msgs/Odometry, before a transform that is odometry is taken
MOST_PAIRS = 1000  # of frames, among which the odometry is looked for


class OdometryInput:
    """
    Hears odometry and hands it on as `take(stamp [s], T_odom_base (3,), slip (3,) or None)`.

    The turn rate of a gyroscope goes on as `take_rate(stamp [s], rate [rad/s])`.
    What cannot be used is counted. Where nav_msgs/Odometry does not come, but a transform that is
    odometry does, that one is taken; it is logged which.
    """

    def __init__(self, node: Any, config: SlamNodeConfig, take: Callable[..., None],
                 take_rate: Callable[[float, float], None], count: Callable[..., None]) -> None:
        self._take, self._take_rate, self._count = take, take_rate, count
        self._joints = (config.left_wheel_joint, config.right_wheel_joint)
        self._wheels = WheelOdometry(config.wheel_radius, config.wheel_separation)
        self._node, self._config = node, config
        self._pairs: set[tuple[str, str]] = set()
        self._transforms: TransformOdometry | None = None
        self._since: float | None = None
        self._heard = float('-inf')
        self._frame_checked = False
        self._odom = self._tf = None
        source, heard = config.odometry_source, []
        options = {'qos_overriding_options': qos.overridable()}
        if source in ('auto', 'odom'):
            self._odom = node.create_subscription(Odometry, names.ODOMETRY, self._on_odometry,
                                                  qos.SENSOR_DATA, **options)
            heard.append(self._odom.topic_name)
        if source == 'encoders':
            heard.append(node.create_subscription(
                JointState, names.JOINT_STATES, self._on_joint_states, qos.SENSOR_DATA,
                **options).topic_name)
        node.create_subscription(Imu, names.IMU, self._on_imu, qos.SENSOR_DATA, **options)
        kind = transform_type(node) if source in ('auto', 'tf') else None
        if kind is not None:
            self._tf = node.create_subscription(kind, names.TF, self._on_transforms,
                                                qos.TRANSFORMS)
            heard.append(self._tf.topic_name)
        self.topic = ', '.join(heard) or 'no odometry'

    @property
    def heard(self) -> float:
        """Time [s, steady clock] at which odometry was heard last; now, where none is wanted."""
        return time.monotonic() if self._config.odometry_source == 'none' else self._heard

    def _on_odometry(self, message: Odometry) -> None:
        """Hand on a pose of the wheel odometry."""
        convert.stamp_if_missing(message.header, self._now(), self._count)
        if self._tf is not None:
            self._node.destroy_subscription(self._tf)
            self._tf = None
        try:
            stamp, pose = convert.odometry_from_message(message)
        except ValueError as error:
            self._count('odometry_not_finite', str(error))
            return
        self._check_frame(message.header.frame_id)
        self._hand_on(stamp, pose, None)

    def _check_frame(self, frame: str) -> None:
        """Count, once, odometry in another frame than map is joined to, whatever its prefix."""
        robot, wanted = self._node.get_namespace().strip('/'), self._config.odom_frame
        if not self._frame_checked and plain(frame):
            self._frame_checked = True
            if bare(frame, robot) != bare(wanted, robot):
                self._count('odom_frame_differs', f'the odometry is in {plain(frame)!r}, but '
                            f'odom_frame is {wanted!r}: map -> {plain(wanted)} may not join the '
                            f"robot's tree; set odom_frame: {plain(frame)}")

    def _on_joint_states(self, message: JointState) -> None:
        """Integrate the two wheels; other joints may come in messages of their own."""
        convert.stamp_if_missing(message.header, self._now(), self._count)
        if self._joints[0] not in message.name and message.name:
            if self._heard == float('-inf'):   # not even once
                self._count('joint_states_without_wheels', f'{self._joints[0]} is not among '
                            f'{", ".join(message.name)}', PATIENCE)
            return
        try:
            stamp, wheels = convert.wheels_from_message(message, *self._joints)
        except ValueError as error:
            self._count('wheels_unusable', str(error))
            return
        self._hand_on(stamp, self._wheels.update(*wheels), self._wheels.slip)

    def _on_imu(self, message: Imu) -> None:
        """Hand on the turn rate about the vertical axis."""
        convert.stamp_if_missing(message.header, self._now(), self._count)
        self._take_rate(convert.seconds(message.header.stamp), float(message.angular_velocity.z))

    def _hand_on(self, stamp: float, pose: Array, slip: Array | None) -> None:
        self._heard = time.monotonic()
        self._take(stamp, pose, slip)

    def _on_transforms(self, message: Any) -> None:
        """Hand on the transform that is odometry, once it is known which."""
        if self._transforms is None:
            self._choose(message)
        if self._transforms is None:
            return
        found = self._transforms(message, convert.seconds(self._now()))
        if found is not None and not np.isfinite(found.pose).all():
            self._count('odometry_not_finite', f'the transform says {found.pose}')
        elif found is not None:
            self._hand_on(found.stamp, found.pose, None)

    def _choose(self, message: Any) -> None:
        """Choose the transform that is odometry: at once where it was asked for by its name."""
        if len(self._pairs) < MOST_PAIRS:
            self._pairs.update(pairs_of(message))
        frames = self._named() or best_odometry(self._pairs,
                                                self._node.get_namespace().strip('/'))
        if frames is None:
            return
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        sure = self._config.odometry_source == 'tf' and (
            is_base(frames[1]) or frames[1] == plain(self._config.base_frame))
        if not sure and now - self._since < PATIENCE:
            return
        self._transforms = TransformOdometry(frames)
        self._node.get_logger().info(
            f'the odometry is taken from /tf: {frames[0]} -> {frames[1]}')
        if frames[0] != plain(self._config.odom_frame):
            self._count('odom_frame_differs', f'the odometry is in {frames[0]!r}: set odom_frame: '
                        f'{frames[0]}, so that map joins this tree')
        if self._odom is not None:
            self._node.destroy_subscription(self._odom)
            self._odom = None

    def _named(self) -> tuple[str, str] | None:
        """Return the transform from odom_frame to the robot; None where none was heard yet."""
        odom, base = plain(self._config.odom_frame), plain(self._config.base_frame)
        named = [child for parent, child in self._pairs if parent == odom]
        return next(((odom, child) for child in (base, *filter(is_base, sorted(named)))
                     if child in named), None)

    def _now(self) -> Any:
        """Return the time of the node as a message."""
        return self._node.get_clock().now().to_msg()
