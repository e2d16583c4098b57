# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot for system tests: it drives through a room and feeds its slam_node."""

from array import array
from itertools import count

from geometry_msgs.msg import PoseWithCovarianceStamped
from helpers import fake_grid, fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
from nav_msgs.msg import OccupancyGrid, Odometry
import numpy as np
from ros_graph import Graph
from sensor_msgs.msg import JointState, LaserScan
from somfusion_ros.geometry import Array, between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import qos

WALLS = fake_room()
ROUND = np.array([[1.5, 1.5], [4.5, 1.0], [6.8, 1.2], [6.8, 3.0], [4.5, 3.0], [2.0, 3.0],
                  [1.5, 5.0], [1.5, 2.0]])
OTHER_ROUND = np.array([[6.0, 5.0], [5.0, 4.5], [4.9, 3.0], [2.5, 2.5], [1.6, 4.8], [1.5, 1.2],
                        [6.5, 1.0]])
MOUNT = Pose(0.12, 0.0, 0.1)
FAST = ('-p', 'map_update_interval:=0.5')
GIVEN_MOUNT = ('-p', f'laser_pose:={list(MOUNT)}')
WINDOW = 20    # scans on the way at once; the subscription is best effort
BEAMS = 257
RADIUS, SEPARATION = 0.08, 0.35


class Robot:
    """A simulated robot: publishes scans and odometry, and hears what its slam_node says."""

    def __init__(self, graph: Graph, name: str, way: Array) -> None:
        self.graph, self.name, self.sent = graph, name, 0
        self.laser_frame = 'laser'
        self.stamps, self.truth = fake_trajectory(way)
        self.stamps = self.stamps + 10.0
        self.odometry = fake_odometry(self.truth)
        make = graph.node.create_publisher
        self._scan = make(LaserScan, f'/{name}/scan', qos.REPLAY)
        self._odom = make(Odometry, f'/{name}/odom', qos.REPLAY)
        self._joints = make(JointState, f'/{name}/joint_states', qos.REPLAY)
        self.poses = graph.hear(PoseWithCovarianceStamped, f'/{name}/pose', qos.STREAM)
        self.maps = graph.hear(OccupancyGrid, f'/{name}/map', qos.LATCHED)

    def start(self, *arguments: str) -> None:
        """Start the node with the mount as a parameter, and drive on once it listens."""
        self.launch(*GIVEN_MOUNT, *arguments)
        self.drive_until_heard()

    def launch(self, *arguments: str) -> None:
        """Start the node and wait until it listens."""
        self.graph.start(f'slam {self.name}', 'slam_node', f'/{self.name}', *FAST, *arguments)
        self.graph.until(lambda: self._scan.get_subscription_count()
                         and (self._odom.get_subscription_count()
                              or self._joints.get_subscription_count())
                         and self.graph.node.count_publishers(f'/{self.name}/pose'),
                         'slam_node listening')

    def drive_until_heard(self) -> None:
        """Stand still until a scan is heard: the node may know us later than we do it."""
        here, known = max(self.sent - 1, 0), len(self.poses)
        begin = self.stamps[here]
        self.stamps[self.sent:] += 5.0
        waited = count(5)

        def heard() -> bool:
            tried = next(waited)     # however often: it stays within the pause
            stamp = begin + 4.9 * tried / (tried + 2450)
            self.publish_odometry(here, stamp)
            self.publish(here, stamp=stamp)
            return len(self.poses) > known
        self.graph.until(heard, 'a pose')
        if not self.sent:
            self.publish_odometry(0)
            self.sent = 1

    def drive(self, last: int) -> None:
        """Drive on up to a scan, and wait until the node has followed."""
        for i in range(self.sent, last):
            self.publish_odometry(i)
            self.publish(i)
            # A best-effort sample may be lost where the machine is held up: do not wait for it.
            self.graph.until(lambda: len(self.poses) > i - WINDOW - 5, f'pose {i - WINDOW}')
        self.sent = last
        self.graph.until(lambda: self.last_stamp() >= self.stamps[last - 1] - 0.11,
                         f'pose at {self.stamps[last - 1]:.1f} s')

    def settle(self) -> Grid:
        """Send the last scan until it is heard, and return the map once nothing changes it."""
        last = self.sent - 1

        def heard() -> bool:
            if self.last_stamp() >= self.stamps[last] - 0.01:
                return True
            self.publish_odometry(last)
            self.publish(last)
            return False
        self.graph.until(heard, 'the last scan')
        # A map is sent again only where no scan and no loop came since.
        self.graph.until(lambda: len(self.maps) > 1 and self.maps[-1] == self.maps[-2]
                         and self.maps[-1].header.stamp == self.poses[-1].header.stamp,
                         'the last map')
        return convert.grid_from_message(self.maps[-1], 10 ** 7)

    def last_stamp(self) -> float:
        """Stamp [s] of the newest pose heard."""
        return convert.seconds(self.poses[-1].header.stamp)

    def publish_odometry(self, i: int, stamp: float | None = None) -> None:
        """Publish odometry, and wheels that did the same."""
        message = Odometry()
        message.header.stamp = convert.time_message(self.stamps[i] if stamp is None else stamp)
        message.pose.pose = convert.pose_message(self.odometry[i])
        self._odom.publish(message)
        steps = between(self.odometry[:-1], self.odometry[1:])[:i]
        travel, turn = np.hypot(steps[:, 0], steps[:, 1]).sum(), steps[:, 2].sum()
        wheels = JointState(name=['left_wheel_joint', 'right_wheel_joint'], position=[
            float(travel - 0.5 * SEPARATION * turn) / RADIUS,
            float(travel + 0.5 * SEPARATION * turn) / RADIUS])
        wheels.header.stamp = message.header.stamp
        self._joints.publish(wheels)

    def publish(self, i: int, ranges: list[float] | None = None, stamp: float | None = None
                ) -> None:
        """Publish a scan, or one with other ranges or another stamp."""
        scan = fake_scan(WALLS, self.truth[i], beams=BEAMS, T_base_laser=MOUNT)
        message = LaserScan(angle_min=scan.angle_min, angle_increment=scan.angle_increment,
                            range_min=scan.range_min, range_max=scan.range_max,
                            ranges=array('f', scan.ranges if ranges is None else ranges))
        message.header.stamp = convert.time_message(self.stamps[i] if stamp is None else stamp)
        message.header.frame_id = self.laser_frame
        self._scan.publish(message)

    def true_pose(self, i: int) -> Array:
        """Return the true pose in the robot's map frame, which lies where the drive began."""
        first = convert.pose_from_message(self.poses[0].pose.pose)
        return compose(first, between(self.truth[0], self.truth[i]))

    def assert_on_course(self, metres: float = 0.15) -> None:
        """Check the newest pose against the truth."""
        i = int(np.argmin(np.abs(self.stamps - self.last_stamp())))
        error = pose_error(convert.pose_from_message(self.poses[-1].pose.pose), self.true_pose(i))
        assert error[0] < metres, f'{error[0]:.2f} m off'
        assert error[1] < np.radians(3.0)

    def true_map(self) -> Grid:
        """Draw the walls in the robot's map frame."""
        first = convert.pose_from_message(self.poses[0].pose.pose)
        return fake_grid(WALLS, T_map_walls=Pose.from_array(
            compose(first, between(self.truth[0], Pose()))))
