# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a slam_node's odometry comes from: nav_msgs/Odometry, or two wheels in joint_states."""

from collections.abc import Callable
import time
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from somfusion_ros.geometry import Array
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.slam.motion import WheelOdometry


class OdometryInput:
    """
    Hears odometry and hands it on as `take(stamp [s], T_odom_base (3,), slip (3,) or None)`.

    What cannot be used is counted. heard [s, steady clock] is when odometry was heard last.
    """

    def __init__(self, node: Any, config: SlamNodeConfig, take: Callable[..., None],
                 count: Callable[..., None]) -> None:
        self._take, self._count = take, count
        self._joints = (config.left_wheel_joint, config.right_wheel_joint)
        self._wheels = WheelOdometry(config.wheel_radius, config.wheel_separation)
        self.heard = float('-inf')
        options = {'qos_overriding_options': qos.overridable()}
        if config.odometry_source == 'odom':
            made = node.create_subscription(Odometry, names.ODOMETRY, self._on_odometry,
                                            qos.SENSOR_DATA, **options)
        else:
            made = node.create_subscription(JointState, names.JOINT_STATES, self._on_joint_states,
                                            qos.SENSOR_DATA, **options)
        self.topic = made.topic_name

    def _on_odometry(self, message: Odometry) -> None:
        """Hand on a pose of the wheel odometry."""
        try:
            stamp, pose = convert.odometry_from_message(message)
        except ValueError as error:
            self._count('odometry_not_finite', str(error))
            return
        self._hand_on(stamp, pose, None)

    def _on_joint_states(self, message: JointState) -> None:
        """Integrate the two wheels; other joints may come in messages of their own."""
        if self._joints[0] not in message.name and message.name:
            return
        try:
            stamp, wheels = convert.wheels_from_message(message, *self._joints)
        except ValueError as error:
            self._count('wheels_unusable', str(error))
            return
        self._hand_on(stamp, self._wheels.update(*wheels), self._wheels.slip)

    def _hand_on(self, stamp: float, pose: Array, slip: Array | None) -> None:
        self.heard = time.monotonic()
        self._take(stamp, pose, slip)
