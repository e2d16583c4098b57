# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry records out of the messages of a bag: odom topic, two wheel encoders, or /tf."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.bags.reader import BagError
from somfusion_ros.io.bags.topics import OdometrySource, stamp
from somfusion_ros.io.frame_names import plain
from somfusion_ros.io.frame_tree import yaw
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.motion_guess import TurnRate
from somfusion_ros.slam.wheel_odometry import WheelOdometry

Converter = Callable[[Any, float], Odometry | None]


def converter(source: OdometrySource, options: BagOptions, path: Path) -> Converter:
    """Return the function (message, time of recording) -> Odometry or None for a source."""
    if source.kind == 'odom':
        return from_odometry
    if source.kind == 'encoders':
        return Encoders(options, path)
    if source.kind == 'none':
        return lambda message, log_time: None
    return TransformOdometry(source.frames)


def turn_rate(message: Any, log_time: float) -> TurnRate:
    """Convert sensor_msgs/Imu: its rate about the vertical axis."""
    return TurnRate(stamp(message.header, log_time), float(message.angular_velocity.z))


def from_odometry(message: Any, log_time: float) -> Odometry:
    """Convert nav_msgs/Odometry."""
    pose, twist = message.pose.pose, message.twist.twist
    return Odometry(
        stamp(message.header, log_time),
        np.array([pose.position.x, pose.position.y, yaw(pose.orientation)]),
        np.array([twist.linear.x, twist.linear.y, twist.angular.z]))


class Encoders:
    """Odometry from the two wheel positions in sensor_msgs/JointState."""

    def __init__(self, options: BagOptions, path: Path) -> None:
        if options.wheel_radius is None or options.wheel_separation is None:
            raise BagError(f'{path}: odometry from encoders needs radius and separation '
                           'of the wheels')
        self._wheels = WheelOdometry(options.wheel_radius, options.wheel_separation)
        self._differences = Differences()
        self._path = path

    def __call__(self, message: Any, log_time: float) -> Odometry | None:
        """Convert one message; None where it does not hold both wheels."""
        names = list(message.name)
        left, right = find_wheels(names)
        if left is None or right is None:
            if any('wheel' in name for name in names):
                raise BagError(f'{self._path}: no left and right wheel among the joints '
                               f'{", ".join(names)}')
            return None
        positions = np.asarray(message.position, dtype=float)
        if len(positions) <= max(left, right) or not np.isfinite(positions[[left, right]]).all():
            return None
        wheels = positions[[left, right]]
        when = stamp(message.header, log_time)
        pose = np.asarray(self._wheels.update(*wheels), dtype=float)
        return Odometry(when, pose, self._differences(when, pose), self._wheels.slip)


def find_wheels(names: list[str]) -> tuple[int | None, int | None]:
    """Find the left and the right wheel joint among joint names, None where missing."""
    def find(side: str) -> int | None:
        candidates = [i for i, name in enumerate(names) if side in name.lower()]
        wheels = [i for i in candidates if 'wheel' in names[i].lower()]
        return next(iter(wheels or candidates), None)
    return find('left'), find('right')


class TransformOdometry:
    """The transform odom -> base in messages of /tf, by the names of its two frames."""

    def __init__(self, frames: tuple[str, str] | None) -> None:
        self._frames = frames
        self._differences = Differences()

    def __call__(self, message: Any, log_time: float) -> Odometry | None:
        """Convert one message; None where it holds no odometry."""
        for item in message.transforms:
            if (plain(item.header.frame_id), plain(item.child_frame_id)) == self._frames:
                t = item.transform
                when = stamp(item.header, log_time)
                pose = np.array([t.translation.x, t.translation.y, yaw(t.rotation)])
                return Odometry(when, pose, self._differences(when, pose))
        return None


class Differences:
    """Twist (3,) in the base frame from successive poses."""

    def __init__(self) -> None:
        self._last: tuple[float, Array] | None = None

    def __call__(self, when: float, pose: Array) -> Array:
        """Mean twist since the last call; zero at the first."""
        last, self._last = self._last, (when, pose)
        if last is None or when <= last[0]:
            return np.zeros(3)
        return between(last[1], pose) / (when - last[0])
