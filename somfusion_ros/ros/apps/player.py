# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Play recorded logs as live robots: scan, odom, joint_states, tf_static, odom -> base_link on tf.

Messages go out as they were recorded, paced by the time of recording. Topics are relative, so that
a namespace makes a log one robot of several; several logs become robot1, robot2 ... of one player
and share one clock.
"""

import argparse
from functools import partial
import threading
import time
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, LaserScan, MultiEchoLaserScan, PointCloud2
from somfusion_ros.io.bags.topics import IMU, JOINTS, ODOMETRY
from somfusion_ros.io.frame_names import plain
from somfusion_ros.ros.apps.player_options import parse
from somfusion_ros.ros.apps.recording import (align, ODOMETRY_IN_TF, Record, Recording, SCANS,
                                              together, TRANSFORMS)
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.optional_types import message_type
from somfusion_ros.ros.common.runtime import plain_args, run

TOPICS: dict[str, tuple[str, type]] = {
    **{msgtype: (names.SCAN, kind) for msgtype, kind in zip(
        SCANS, (LaserScan, MultiEchoLaserScan, PointCloud2), strict=True)},
    ODOMETRY: (names.ODOMETRY, Odometry), JOINTS: (names.JOINT_STATES, JointState),
    IMU: (names.IMU, Imu)}
CLOCK_PERIOD = 0.01         # [s] between two words on /clock
SETTLE = 1.0                # [s] for the listeners to learn of this publisher as well
ACKNOWLEDGED_WITHIN = 5.0   # [s] for the last messages to arrive


class RobotTopics:
    """The publishers of one recording, below a prefix."""

    def __init__(self, node: Node, recording: Recording, prefix: str, tf: Any) -> None:
        self._by_type: dict[str, Any] = {
            msgtype: node.create_publisher(kind, f'{prefix}{topic}', qos.REPLAY)
            for msgtype, (topic, kind) in TOPICS.items() if msgtype in recording.msgtypes}
        self.sensors = [made for msgtype, made in self._by_type.items() if msgtype != IMU]
        self._tf, self._driver = tf, None
        if tf is not None and TRANSFORMS in recording.msgtypes:
            self._by_type[TRANSFORMS] = node.create_publisher(tf, f'{prefix}tf_static',
                                                              qos.LATCHED_PER_PAIR)
        if tf is not None and ODOMETRY in recording.msgtypes:
            self._driver = node.create_publisher(tf, f'{prefix}tf', qos.TRANSFORMS)
        if tf is not None and ODOMETRY_IN_TF in recording.msgtypes:
            self._by_type[ODOMETRY_IN_TF] = node.create_publisher(tf, f'{prefix}tf',
                                                                  qos.TRANSFORMS)

    def publish(self, record: Record) -> None:
        """Publish a record as it is; what odometry says, also as the robot's driver says it."""
        publisher = self._by_type.get(record.msgtype)
        if publisher is not None:
            publisher.publish(record.data)
        if record.msgtype == ODOMETRY and self._driver is not None:
            odometry = deserialize_message(record.data, Odometry)
            self._driver.publish(self._tf(transforms=[convert.transform_message(
                convert.pose_from_message(odometry.pose.pose),
                plain(odometry.header.frame_id) or 'odom',
                plain(odometry.child_frame_id) or 'base_link', odometry.header.stamp)]))

    def heard(self) -> bool:
        """Return whether someone listens to the scans and to an odometry."""
        return sum(bool(p.get_subscription_count()) for p in self.sensors) >= min(
            2, len(self.sensors))

    @property
    def unheard(self) -> str:
        """Names of the topics that a SLAM is to hear, and nobody does, with commas between."""
        return ', '.join(sorted(publisher.topic_name for publisher in self.sensors
                                if not publisher.get_subscription_count()))

    def finish(self) -> None:
        """Wait until the last messages have arrived."""
        for publisher in self.sensors:
            publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_WITHIN))


class PlayerNode(Node):
    """Publishes bags from a thread of its own, then sets the stop event."""

    status = 0

    def __init__(self, options: argparse.Namespace, stop: threading.Event) -> None:
        super().__init__('player')
        self._options, self._stop = options, stop
        self._recordings = [Recording(bag, *topics) for bag, *topics in zip(
            options.bags, each(options.scan_topic, options), each(options.odom_topic, options),
            strict=True)]
        align(self._recordings)
        self._said: set[str] = set()
        self._say_notes()
        tf = message_type('tf2_msgs.msg', 'TFMessage')
        if tf is None:
            self.get_logger().info('tf2_msgs is not there: no transforms are played')
        self._robots = [RobotTopics(self, recording, prefix, tf) for recording, prefix in zip(
            self._recordings, prefixes(options), strict=True)]
        self._clock_topic = (self.create_publisher(Clock, '/clock', qos.LATEST)
                             if options.clock else None)
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def close(self, timeout: float) -> bool:
        """Stop playing; return whether the thread ended in time."""
        self._stop.set()
        self._thread.join(timeout)
        for recording in self._recordings:
            recording.close()
        return not self._thread.is_alive()

    def _say_notes(self) -> None:
        """Say what was mended in the bags so far, each once."""
        for note in (note for recording in self._recordings for note in recording.notes):
            if note not in self._said:
                self._said.add(note)
                self.get_logger().warning(note)

    def _play(self) -> None:
        """Publish every message at its time."""
        try:
            begin = min(recording.start + recording.shift for recording in self._recordings)
            self._wait_for_listeners(begin)
            start = time.monotonic()
            for number, record in together(self._recordings):
                if not self._wait_until(record.time, begin, start):
                    return
                self._robots[number].publish(record)
            for robot in self._robots:
                robot.finish()
            self._say_notes()
            self.get_logger().info(f'played {", ".join(map(str, self._options.bags))} in '
                                   f'{time.monotonic() - start:.1f} s')
        except Exception as error:   # the library raises many kinds on a damaged file
            self.get_logger().error(f'{", ".join(map(str, self._options.bags))}: {error}')
            self.status = 1
        finally:
            self._stop.set()

    def _wait_until(self, stamp: int, begin: int, start: float) -> bool:
        """Wait for a time [ns] of recording, and say what time it is; False if told to stop."""
        rate = self._options.rate
        due = start + (stamp - begin) * 1e-9 / rate
        while (left := due - time.monotonic()) > 0.0:
            self._tell_time(begin + int((time.monotonic() - start) * rate * 1e9))
            if self._stop.wait(min(left, CLOCK_PERIOD) if self._clock_topic else left):
                return False
        self._tell_time(stamp)
        return not self._stop.is_set()

    def _tell_time(self, now: int) -> None:
        """Publish the time [ns] on /clock, unless that was done a moment ago."""
        if self._clock_topic is not None and time.monotonic() >= self._told + CLOCK_PERIOD:
            self._told = time.monotonic()
            seconds, nanoseconds = divmod(now, 10 ** 9)
            self._clock_topic.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    _told = float('-inf')   # [s, steady clock] when the time was published last

    def _wait_for_listeners(self, begin: int) -> None:
        """Wait until someone listens to every robot, for a bounded time."""
        until = time.monotonic() + self._options.wait
        while time.monotonic() < until and not self._stop.wait(0.05):
            self._tell_time(begin)
            if all(robot.heard() for robot in self._robots):
                self._stop.wait(SETTLE)
                return
        for robot in self._robots:
            if not robot.heard() and not self._stop.is_set():
                self.get_logger().warning(
                    f'nobody listens to {robot.unheard}: is slam_node in this namespace, with '
                    'this odometry_source? It is played all the same')


def each(topics: list[str], options: argparse.Namespace) -> list[str | None]:
    """Return the topic that was named for each bag; None where it is to be found."""
    found: list[str | None] = [*topics] or [None]
    return found * (1 if len(found) > 1 else len(options.bags))


def prefixes(options: argparse.Namespace) -> list[str]:
    """Return the prefix of each bag's topics: none for one bag, else the robot's name."""
    robots = options.robots or ([] if len(options.bags) == 1 else [
        f'robot{number}' for number in range(1, len(options.bags) + 1)])
    if robots and len(robots) != len(options.bags):
        raise ValueError(f'{len(robots)} robots for {len(options.bags)} bags')
    if len(set(robots)) < len(robots):
        raise ValueError(f'robots {", ".join(robots)}: each needs a name of its own')
    return [f'{robot.strip("/")}/' for robot in robots] or ['']


def main(args: list[str] | None = None) -> int:
    """Play bags: `player BAG [BAG ...] [--rate R] [--clock] --ros-args -r __ns:=/robot1`."""
    options = parse(plain_args(args))
    return run(partial(PlayerNode, options), args)


if __name__ == '__main__':
    raise SystemExit(main())
