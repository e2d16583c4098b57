# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Plays one robot's recorded log as live topics: scan, odom, joint_states, tf_static.

Messages go out as they were recorded, with their own stamps, paced by the time of recording.
Topics are relative, so that a namespace makes the log one robot of several.
"""

import argparse
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import threading
import time
from typing import Any, NamedTuple

from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from sensor_msgs.msg import JointState, LaserScan
from somfusion_ros.ros.common import qos
from somfusion_ros.ros.common.runtime import plain_args, run

TOPICS = {'sensor_msgs/msg/LaserScan': ('scan', LaserScan, qos.REPLAY),
          'nav_msgs/msg/Odometry': ('odom', Odometry, qos.REPLAY),
          'sensor_msgs/msg/JointState': ('joint_states', JointState, qos.REPLAY)}
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
SETTLE = 1.0                # [s] for the listeners to learn of this publisher as well
ACKNOWLEDGED_WITHIN = 5.0   # [s] for the last messages to arrive


class Record(NamedTuple):
    """One message: time of recording [s] from the bag's start, its type, its CDR bytes."""

    time: float
    msgtype: str
    data: bytes


def open_bag(path: str | Path) -> AnyReader:
    """Make a reader for a rosbag1 or rosbag2 (sqlite3, mcap) bag, or a folder with `bag` in it."""
    path = Path(path)
    if (path / 'bag').exists() and not (path / 'metadata.yaml').exists():
        path = path / 'bag'
    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))


def is_played(connection: Any) -> bool:
    """Return whether a bag's topic is played: of the transforms only those that never change."""
    return connection.msgtype in TOPICS or (
        connection.msgtype == TRANSFORMS and connection.topic.endswith('tf_static'))


def read_records(reader: AnyReader, msgtypes: set[str]) -> Iterator[Record]:
    """Yield the played messages of some types in the order of recording."""
    connections = [c for c in reader.connections if is_played(c) and c.msgtype in msgtypes]
    ros1 = get_typestore(Stores.ROS1_NOETIC) if not reader.is2 else None
    if connections:
        for connection, nanoseconds, raw in reader.messages(connections=connections):
            data = bytes(ros1.ros1_to_cdr(raw, connection.msgtype)) if ros1 else raw
            yield Record((nanoseconds - reader.start_time) * 1e-9, connection.msgtype, data)


class PlayerNode(Node):
    """Publishes a bag from a thread of its own, then sets the stop event."""

    status = 0

    def __init__(self, options: argparse.Namespace, stop: threading.Event) -> None:
        super().__init__('player')
        self._options, self._stop = options, stop
        try:
            self._reader = open_bag(options.bag)
            self._reader.open()
        except Exception as error:   # the library raises many kinds on a damaged file
            raise ValueError(f'{options.bag}: not a readable bag ({error})') from error
        self._publishers_by_type = self._make_publishers()
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def close(self, timeout: float) -> bool:
        """Stop playing; return whether the thread ended in time."""
        self._stop.set()
        self._thread.join(timeout)
        self._reader.close()
        return not self._thread.is_alive()

    def _make_publishers(self) -> dict[str, Any]:
        """Make a publisher for each kind of message that the bag holds."""
        topics = dict(TOPICS)
        try:
            topics[TRANSFORMS] = (
                'tf_static', import_module('tf2_msgs.msg').TFMessage, qos.LATCHED_PER_PAIR)
        except ImportError:
            self.get_logger().info('tf2_msgs is not there: the mount of the laser is not played')
        held = {c.msgtype for c in self._reader.connections if is_played(c)}
        return {msgtype: self.create_publisher(cls, topic, profile)
                for msgtype, (topic, cls, profile) in topics.items() if msgtype in held}

    def _play(self) -> None:
        """Publish every message at its time."""
        try:
            self._wait_for_listeners()
            start = time.monotonic()
            for count, record in enumerate(read_records(self._reader,
                                                        set(self._publishers_by_type))):
                due = start + record.time / self._options.rate
                if self._stop.wait(max(0.0, due - time.monotonic())):
                    return
                self._publishers_by_type[record.msgtype].publish(record.data)
            self._finish(start)
        except Exception as error:   # the library raises many kinds on a damaged file
            self.get_logger().error(f'{self._options.bag}: {error}')
            self.status = 1
        finally:
            self._stop.set()

    def _wait_for_listeners(self) -> None:
        """Wait until someone listens to the scans and to an odometry, for a bounded time."""
        until = time.monotonic() + self._options.wait
        while time.monotonic() < until and not self._stop.wait(0.05):
            heard = {msgtype for msgtype, publisher in self._publishers_by_type.items()
                     if publisher.get_subscription_count()}
            if len(heard & set(TOPICS)) >= 2:
                self._stop.wait(SETTLE)
                return

    def _finish(self, start: float) -> None:
        """Wait until the last messages have arrived."""
        for publisher in self._publishers_by_type.values():
            publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_WITHIN))
        self.get_logger().info(f'played {self._options.bag} in {time.monotonic() - start:.1f} s')


def main(args: list[str] | None = None) -> int:
    """Play a bag: `player BAG [--rate R] [--wait S] --ros-args -r __ns:=/robot1`."""
    parser = argparse.ArgumentParser(prog='player', description=main.__doc__)
    parser.add_argument('bag', help='rosbag2 folder, .mcap, .db3 or rosbag1 file')
    parser.add_argument('--rate', type=float, default=1.0, help='times real time')
    parser.add_argument('--wait', type=float, default=10.0,
                        help='seconds to wait for listeners before playing')
    options = parser.parse_args(plain_args(args))
    if not options.rate > 0:
        parser.error('--rate must be positive')
    return run(lambda stop: PlayerNode(options, stop), args)


if __name__ == '__main__':
    raise SystemExit(main())
