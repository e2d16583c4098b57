# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with scans, odometry, wheel encoders and the laser's mount, as rosbag2 writes them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from rosbags.interfaces import (Qos, QosDurability, QosHistory, QosLiveliness, QosReliability,
                                QosTime)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.scan import Scan

if TYPE_CHECKING:
    from typing_extensions import Self

STORAGES = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
WHEELS = ['left_wheel_joint', 'right_wheel_joint']


class BagWriter:
    """
    A rosbag2 bag being written; a context manager.

    Stamps are given in seconds; `recorded` is the time of recording, None: the stamp. namespace
    and frames (odom, base, laser) are those of the robot whose messages are written now.
    """

    latched: tuple[str, ...] = ('tf_static',)   # last names of topics for late listeners

    def __init__(self, folder: Path, storage: str = 'mcap',
                 frames: tuple[str, str, str] = ('odom', 'base_link', 'laser')) -> None:
        self._writer = Writer(folder, version=9, storage_plugin=STORAGES[storage])
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.frames, self.namespace = frames, ''
        self._connections: dict[str, Any] = {}
        self.recorded: float | None = None

    def __enter__(self) -> 'Self':
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def mount(self, stamp: float, T_base_laser: Pose, height: float = 0.0) -> None:
        """Write tf_static: base -> laser."""
        self.transform('/tf_static', stamp, self.frames[1], self.frames[2],
                       (*T_base_laser[:2], height), quaternion(T_base_laser[2]))

    def transform(self, topic: str, stamp: float, parent: str, child: str,
                  translation: Sequence[float], quaternion: Sequence[float]) -> None:
        """Write a transform, translation (3,) [m] and quaternion x y z w, to /tf or /tf_static."""
        make = self._make
        transform = make('geometry_msgs/msg/TransformStamped', self._header(stamp, parent), child,
                         make('geometry_msgs/msg/Transform',
                              make('geometry_msgs/msg/Vector3', *map(float, translation)),
                              make('geometry_msgs/msg/Quaternion', *map(float, quaternion))))
        self._write(topic, TRANSFORMS, stamp, [transform])

    def scan(self, scan: Scan, scan_time: float = 0.0, topic: str = '/scan') -> None:
        """Write a laser scan."""
        ranges = np.asarray(scan.ranges, dtype=np.float32)
        self._write(self._own(topic), 'sensor_msgs/msg/LaserScan', scan.stamp,
                    self._header(scan.stamp, self.frames[2]),
                    scan.angle_min, scan.angle_min + scan.angle_increment * (len(ranges) - 1),
                    scan.angle_increment, scan.time_increment, scan_time, scan.range_min,
                    scan.range_max, ranges, np.zeros(0, np.float32))

    def odometry(self, stamp: float, pose: ArrayLike, twist: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Write T_odom_base (3,) and the twist (3,) in the base frame."""
        x, y, theta = np.asarray(pose, dtype=float)
        vx, vy, turn = np.asarray(twist, dtype=float)
        make = self._make
        place = make('geometry_msgs/msg/Pose',
                     make('geometry_msgs/msg/Point', x, y, 0.0),
                     make('geometry_msgs/msg/Quaternion', *quaternion(theta)))
        speed = make('geometry_msgs/msg/Twist', make('geometry_msgs/msg/Vector3', vx, vy, 0.0),
                     make('geometry_msgs/msg/Vector3', 0.0, 0.0, turn))
        unknown = np.zeros(36)
        self._write(self._own('/odom'), 'nav_msgs/msg/Odometry', stamp,
                    self._header(stamp, self.frames[0]), self.frames[1],
                    make('geometry_msgs/msg/PoseWithCovariance', place, unknown),
                    make('geometry_msgs/msg/TwistWithCovariance', speed, unknown))

    def wheels(self, stamp: float, positions: ArrayLike) -> None:
        """Write the wheel encoders (2,) left, right [rad]."""
        nothing = np.zeros(0)
        self._write(self._own('/joint_states'), 'sensor_msgs/msg/JointState', stamp,
                    self._header(stamp, ''), WHEELS, np.asarray(positions, dtype=float),
                    nothing, nothing)

    def _own(self, topic: str) -> str:
        """Return the topic in the namespace of the robot whose messages are written now."""
        return f'/{self.namespace}{topic}' if self.namespace else topic

    def _write(self, topic: str, msgtype: str, stamp: float, *fields: Any) -> None:
        """Serialise a message and write it."""
        if topic not in self._connections:
            latched = topic.rpartition('/')[2] in self.latched
            qos = [_transient_local()] if latched else []
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=self._store, offered_qos_profiles=qos)
        raw = self._store.serialize_cdr(self._make(msgtype, *fields), msgtype)
        recorded = stamp if self.recorded is None else self.recorded
        self._writer.write(self._connections[topic], round(recorded * 1e9), raw)

    def _make(self, msgtype: str, *fields: Any) -> Any:
        """Make a message."""
        return self._store.types[msgtype](*fields)

    def _header(self, stamp: float, frame: str) -> Any:
        """Make a header."""
        seconds, nanoseconds = divmod(round(stamp * 1e9), 10 ** 9)
        return self._make('std_msgs/msg/Header', self._make(
            'builtin_interfaces/msg/Time', seconds, nanoseconds), frame)


def quaternion(theta: float) -> tuple[float, float, float, float]:
    """Return the quaternion x y z w of a heading [rad]."""
    return 0.0, 0.0, float(np.sin(0.5 * theta)), float(np.cos(0.5 * theta))


def _transient_local() -> Qos:
    """Return the QoS under which static transforms are played again for late listeners."""
    never = QosTime(0, 0)
    return Qos(history=QosHistory.KEEP_LAST, depth=1, reliability=QosReliability.RELIABLE,
               durability=QosDurability.TRANSIENT_LOCAL, deadline=never, lifespan=never,
               liveliness=QosLiveliness.AUTOMATIC, liveliness_lease_duration=never,
               avoid_ros_namespace_conventions=False)
