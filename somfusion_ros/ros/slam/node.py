# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
slam_node: one robot's scans and odometry in, its map, pose and path out.

The callbacks only convert and keep. One thread follows the robot scan by scan, another one
closes loops and draws maps, so that neither of them holds up what comes in.
"""

import time
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import LaserScan
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.io.maps import write_map
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, parameters, qos
from somfusion_ros.ros.common.diagnostics import Faults
from somfusion_ros.ros.common.runtime import run
from somfusion_ros.ros.common.tf import Mounts
from somfusion_ros.ros.common.worker import Worker
from somfusion_ros.ros.slam.odometry_input import OdometryInput
from somfusion_ros.ros.slam.peer_bodies import PeerBodies
from somfusion_ros.ros.slam.publisher import SlamPublisher
from somfusion_ros.ros.slam.status import Last, silence, slam_status
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from std_srvs.srv import Trigger

TICK = 0.1           # [s] between looks at scans that wait in vain
REPORT_PERIOD = 1.0  # [s] between two diagnostics
PATIENCE = 2.0       # [s] for which something may be missing after the start before it is said


class SlamNode(Node):
    """The ROS side of one robot's SLAM."""

    def __init__(self) -> None:
        super().__init__('slam_node')
        self._config = parameters.declare(self, SlamNodeConfig)
        self._count = Faults(self.get_logger())
        self._keeper = CheckpointKeeper(self._config.state_file, self._config.state_interval,
                                        self._count, self.get_logger().info)
        state = self._keeper.load()
        self._slam_config = parameters.declare(self, SlamConfig, changeable=True)
        self._session = Session(self._slam_config, self._config.transform_timeout, self._count,
                                state)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._publisher = SlamPublisher(self, self._config)
        self._mounts = Mounts(self, Pose.from_array(self._config.laser_pose))
        self._ticks = 0
        self._last = Last(reported=(0, time.monotonic()))
        self._map: OccupancyGrid | None = None
        self._map_due = 0.0
        self._drawn: Any = state   # what the map was drawn after: a step, or a state
        if state is not None:
            self._last.stamp = convert.time_message(self._session.slam.last_stamp)
        self._tracker = Worker(self._process, self._on_worker_error, TICK)
        self._worker = Worker(self._work, self._on_worker_error)
        self._make_interfaces()
        self._tracker.start()
        self._worker.start()

    def close(self, timeout: float) -> bool:
        """Stop both threads; return whether they ended in time."""
        ended = self._tracker.close(timeout)
        ended = self._worker.close(timeout) and ended
        if ended:
            self._keeper.keep(self._session.slam, self._last.step, float('inf'))
        return ended

    def _make_interfaces(self) -> None:
        """Make every topic, service and timer; all names are relative."""
        scans = self.create_subscription(LaserScan, names.SCAN, self._on_scan, qos.SENSOR_DATA,
                                         qos_overriding_options=qos.overridable())
        self._bodies = PeerBodies(self, self._config.peer_radius)
        self._odometry = OdometryInput(self, self._config, self._on_odometry, self._count)
        self._inputs = f'{scans.topic_name}, {self._odometry.topic}'
        # A group of its own: while it waits for the worker, the other callbacks go on.
        self.create_service(Trigger, names.SAVE_MAP, self._save_map,
                            callback_group=MutuallyExclusiveCallbackGroup())
        self.create_service(Trigger, names.RESET, self._reset)
        self.create_service(GetMap, names.DYNAMIC_MAP, self._dynamic_map)
        steady = Clock(clock_type=ClockType.STEADY_TIME)   # a paused simulation must not stop it
        self.create_timer(TICK, self._tick, clock=steady)
        self.create_timer(REPORT_PERIOD, self._report, clock=steady)
        if self._publisher.sends_transforms:
            self.create_timer(self._config.transform_publish_period, self._send_transform,
                              clock=steady)

    def _on_scan(self, message: LaserScan) -> None:
        """Let a scan wait for its odometry, and process what need not wait any more."""
        self._last.scan_heard = time.monotonic()
        mount = self._mount_of(message.header.frame_id)
        if mount is None:
            self._count('scans_without_mount', self._last.lacking, PATIENCE)
            return
        scan = convert.scan_from_message(message, mount.T_base_laser, mount.upside_down)
        self._session.bodies = self._bodies.known()
        self._session.add_scan(scan, message.header.stamp, self._ticks * TICK)
        self._tracker.wake()

    def _mount_of(self, laser: str) -> Mount | None:
        """Return the mount of a laser; None, with the reason kept, where there is none to use."""
        base, self._last.lacking = self._config.base_frame, ''
        try:
            mount = self._mounts.find(base, laser)
        except ValueError as error:
            self._last.lacking = str(error)
            return None
        if mount is None:
            self._last.lacking = (f'no transform {base} -> {laser} on /tf_static: publish it, or '
                                  'set laser_pose')
        return mount

    def _on_odometry(self, stamp: float, pose: Array, slip: Array | None) -> None:
        """Keep a pose of the wheel odometry."""
        self._session.add_odometry(stamp, pose, slip)
        self._tracker.wake()

    def _process(self) -> bool:
        """Follow the robot through one scan that odometry covers; return whether there was one."""
        start = time.perf_counter()
        found = next(self._session.steps(self._ticks * TICK), None)
        if found is None or self._tracker.stopping:
            return False
        stamp, step = found
        self._last.scan_seconds = time.perf_counter() - start
        self._last.scans += 1
        if step.accepted:
            self._last.stamp, self._last.step = stamp, step
            self._publisher.pose(step, stamp)
        return True

    def _tick(self) -> None:
        """
        Let time pass for the scans that wait.

        Ticks are the clock of the waiting: they stand still while this thread is held up, so a
        scan is never dropped for odometry that lies in the inbox already.
        """
        self._ticks += 1

    def _send_transform(self) -> None:
        """Repeat map -> odom."""
        if self._last.step is not None:
            self._publisher.transform(self._last.step, self._last.stamp)

    def _work(self) -> bool:
        """Close one loop or draw the map, in the worker; return whether there is more."""
        more = self._session.slam.work()
        if time.monotonic() >= self._map_due and self._last.step is not self._drawn:
            self._drawn = self._last.step
            self._publish_map()
            self._map_due = time.monotonic() + self._config.map_update_interval
        self._keeper.keep(self._session.slam, self._last.step, time.monotonic())
        return more

    def _publish_map(self) -> Grid:
        """Draw and publish the map."""
        slam, stamp = self._session.slam, self._last.stamp or Time()
        grid = slam.grid()
        if not self._worker.stopping:
            self._map = self._publisher.grid(grid, slam, stamp)
        return grid

    def _report(self) -> None:
        """Publish the status of the node, and log why nothing comes out."""
        self._last.odometry_heard = self._odometry.heard
        kind, reason = silence(self._last, time.monotonic())
        if kind:
            self._count(kind, f'{reason} (on {self._inputs})', PATIENCE)
        self._publisher.diagnostics(slam_status(
            self.get_fully_qualified_name().lstrip('/'), self.get_namespace(), self._last,
            self._session.slam, self._count.counts(), time.monotonic()))

    def _on_parameters(self, changes: list[Any]) -> Any:
        """Apply live changes, all or none."""
        config, result = parameters.change(self._config, changes)
        if result.successful:
            self._slam_config, result = parameters.change(self._slam_config, changes)
        if result.successful:
            self._config = config
            self._session.configure(self._slam_config)
        return result

    def _on_worker_error(self, error: Exception) -> None:
        self._count('worker_errors', repr(error))

    def _dynamic_map(self, request: Any, response: GetMap.Response) -> GetMap.Response:
        """Answer with the map as published last."""
        if self._map is not None:
            response.map = self._map
        return response

    async def _save_map(self, request: Any, response: Trigger.Response) -> Trigger.Response:
        """Write the map as it is now; the worker draws it, so that scans go on meanwhile."""
        saved = Future(executor=self.executor)
        self._worker.submit(lambda: saved.set_result(self._save()))
        response.success, response.message = await saved
        return response

    def _save(self) -> tuple[bool, str]:
        """Write map.yaml and map.pgm; return whether it went well, and the path or the reason."""
        try:
            return True, str(write_map(self._config.map_directory, self._publish_map()))
        except OSError as error:
            return False, str(error)

    def _reset(self, request: Any, response: Trigger.Response) -> Trigger.Response:
        """Begin a new map."""
        self._session.reset()
        self._keeper.forget()
        self._last.step = None
        response.success, response.message = True, 'a new map begins'
        return response


def main(args: list[str] | None = None) -> int:
    """Run slam_node until SIGINT or SIGTERM."""
    return run(lambda stop: SlamNode(), args)


if __name__ == '__main__':
    raise SystemExit(main())
