# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
fusion_node: the maps of a robot and of its peers in, relative transforms and a global map out.

Callbacks only keep what arrived; matching and merging run in a worker thread.
"""

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from somfusion_ros.config import FusionConfig, FusionNodeConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.grid import Grid
from somfusion_ros.ros import conversions as convert
from somfusion_ros.ros import parameters, qos
from somfusion_ros.ros.diagnostics import Faults
from somfusion_ros.ros.fusion_drawing import fusion_statuses
from somfusion_ros.ros.fusion_publisher import FusionPublisher
from somfusion_ros.ros.fusion_session import FusionSession
from somfusion_ros.ros.peers import find_peers, from_sighting, Heard, robot_of
from somfusion_ros.ros.runtime import run
from somfusion_ros.ros.worker import Worker
from somfusion_ros.tools.maps import write_map
from std_srvs.srv import Trigger

REPORT_PERIOD = 1.0   # [s] between two diagnostics
DRAWING_SHARE = 4.0   # at most one part in so many of the time goes into drawing the global map


class FusionNode(Node):
    """The ROS side of one robot's part in the team."""

    def __init__(self) -> None:
        super().__init__('fusion_node')
        self._config = parameters.declare(self, FusionNodeConfig)
        self._fusion = parameters.declare(self, FusionConfig, changeable=True)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._name = (self._config.robot_name or self.get_namespace()).strip('/')
        if not self._name:
            raise ValueError('fusion_node in the root namespace cannot tell its robot from the '
                             'others: start it in a namespace (--ros-args -r __ns:=/robot1) or '
                             'set the parameter robot_name')
        self._count = Faults(self.get_logger())
        self._session = FusionSession(self._name, self._config, self._fusion,
                                      self.get_logger().info)
        self._heard: dict[str, Heard] = {}
        self._inbox: dict[str, OccupancyGrid] = {}
        self._alive: set[str] = set()
        self._global: Grid | None = None
        self._draw_due = 0.0
        self._worker = Worker(self._work, lambda error: self._count('worker_errors', repr(error)))
        self._make_interfaces()
        self._worker.start()

    def close(self, timeout: float) -> bool:
        """Stop the worker; tell whether it ended in time."""
        return self._worker.close(timeout)

    def _make_interfaces(self) -> None:
        """Make every topic, service and timer; all but the peers' names are relative."""
        config, waiting = self._config, MutuallyExclusiveCallbackGroup()
        self._own_topic = self.resolve_topic_name(config.robot_map_topic)
        self._listen(self._name, config.robot_map_topic, 'pose')
        self.create_subscription(PoseWithCovarianceStamped, 'encounters', self._on_encounter,
                                 qos.STREAM)
        self._publisher = FusionPublisher(self, self._name, config)
        jobs = {'merge': self._merge, 'save_map': self._save, 'reset': self._reset}
        for name, job in jobs.items():
            self.create_service(Trigger, f'~/{name}', partial(self._serve, job),
                                callback_group=waiting)
        steady = Clock(clock_type=ClockType.STEADY_TIME)   # a paused simulation must not stop it
        self.create_timer(1.0 / config.discovery_rate, self._discover, clock=steady)
        self.create_timer(1.0 / config.merging_rate, self._publish_transforms, clock=steady)
        self.create_timer(REPORT_PERIOD, self._report, clock=steady)

    def _listen(self, robot: str, map_topic: str, pose_topic: str) -> None:
        """Subscribe to one robot's map and pose."""
        self._heard[robot] = Heard()
        self.create_subscription(OccupancyGrid, map_topic, partial(self._on_map, robot),
                                 qos.LATCHED)
        self.create_subscription(PoseWithCovarianceStamped, pose_topic,
                                 partial(self._on_pose, robot), qos.STREAM)

    def _discover(self) -> None:
        """Listen to every robot that is new."""
        config = self._config
        for peer in find_peers(self.get_topic_names_and_types(), config.robot_map_topic,
                               self._own_topic, config.peers):
            if peer not in self._heard:
                self.get_logger().info(f'{self._name} found {peer}')
                self._listen(peer, f'/{peer}/{config.robot_map_topic}', f'/{peer}/pose')
                self.create_subscription(TransformStamped, f'/{peer}/relative_transforms',
                                         partial(self._on_transform, peer), qos.LATCHED_PER_PAIR)
        self._alive = {robot for robot in self._heard
                       if self.count_publishers(f'/{robot}/relative_transforms')}

    def _on_map(self, robot: str, message: OccupancyGrid) -> None:
        """Keep a robot's newest map until the worker has time for it."""
        heard = self._heard[robot]
        heard.map_at, heard.maps = time.monotonic(), heard.maps + 1
        heard.map_bytes += len(message.data)
        self._inbox[robot] = message

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        """Keep a robot's pose in its own map."""
        try:
            pose = convert.pose_from_message(message.pose.pose)
        except ValueError as error:
            self._count(f'pose_of_{robot}_unusable', str(error))
            return
        self._heard[robot].poses.append((convert.seconds(message.header.stamp), pose))

    def _on_transform(self, owner: str, message: TransformStamped) -> None:
        """Take what a peer accepted."""
        peer = robot_of(message.child_frame_id)
        try:
            T_owner_peer = convert.transform_from_message(message)
        except ValueError as error:
            self._count(f'transform_of_{owner}_unusable', str(error))
            return
        if peer:
            now = time.monotonic()
            self._worker.submit(
                lambda: self._session.take_transform(owner, peer, T_owner_peer, now))

    def _on_encounter(self, message: PoseWithCovarianceStamped) -> None:
        """Take a sighting of a peer, where both robots' poses at that time are known."""
        peer, stamp = message.header.frame_id.strip('/'), convert.seconds(message.header.stamp)
        own, other = (self._heard[robot].pose_at(stamp) if robot in self._heard else None
                      for robot in (self._name, peer))
        try:
            if own is None or other is None:
                raise ValueError(f'no pose of {self._name} or of {peer!r} at {stamp:.3f} s')
            seen = from_sighting(own, convert.pose_from_message(message.pose.pose), other)
        except ValueError as error:
            self._count('encounters_unusable', str(error))
            return
        self._worker.submit(lambda: self._session.take_sighting(peer, seen))

    def _work(self) -> bool:
        """Do one piece of work in the worker; tell whether there is more."""
        self._take_maps()
        now = time.monotonic()
        self._session.expire(self._alive, now)
        self._session.refresh()
        self._draw()
        return self._session.attempt(now) is not None

    def _take_maps(self) -> None:
        """Convert the maps that arrived; bad ones are counted and change nothing."""
        for robot in list(self._inbox):
            message = self._inbox.pop(robot)
            try:
                grid = convert.grid_from_message(message, self._config.max_map_cells)
                if not grid.known.any():
                    raise ValueError('grid is all unknown')
            except ValueError as error:
                self._count(f'map_of_{robot}_unusable', str(error))
                continue
            if self._session.take_map(robot, grid) and robot == self._name:
                self._publisher.learned(learn(grid, self._fusion))

    def _draw(self, force: bool = False) -> None:
        """Draw and publish the global map where it changed, not more often than is good."""
        start = time.monotonic()
        if start < self._draw_due and not force:
            return
        try:
            grid = self._session.draw()
        except ValueError as error:
            self._count('global_map_impossible', str(error))
            return
        if grid is not None and not self._worker.stopping:
            self._global = grid
            self._publisher.global_map(grid)
            took = time.monotonic() - start
            self._draw_due = start + max(1.0 / self._config.merging_rate, DRAWING_SHARE * took)

    def _publish_transforms(self) -> None:
        """Repeat what is accepted."""
        self._publisher.transforms(self._session.snapshot, self._heard, self._alive)

    def _report(self) -> None:
        """Tell /diagnostics how the node and each peer are doing."""
        self._publisher.diagnostics(fusion_statuses(
            self.get_fully_qualified_name().lstrip('/'), self._name, self._session.snapshot,
            self._heard, self._count.counts(), time.monotonic(), self._config.peer_timeout))

    def _on_parameters(self, changes: list[Any]) -> Any:
        """Take live changes of the merge's parameters, all or none."""
        self._fusion, result = parameters.change(self._fusion, changes)
        self._session.fusion = self._fusion
        return result

    async def _serve(self, job: Callable[[], str], request: Any,
                     response: Trigger.Response) -> Trigger.Response:
        """Let the worker do a job; callbacks go on meanwhile."""
        done = Future(executor=self.executor)
        self._worker.submit(lambda: done.set_result(_outcome(job)))
        response.success, response.message = await done
        return response

    def _merge(self) -> str:
        """Match every pair now, whether its maps changed or not."""
        self._take_maps()
        now = time.monotonic()
        for _ in self._session.peers():
            self._session.attempt(now, force=True)
        world = self._session.refresh().world(self._name)
        self._draw(force=True)
        return f'connected: {", ".join(sorted(world)) or "nobody"}'

    def _save(self) -> str:
        """Write global_map.yaml and global_map.pgm."""
        if self._global is None:
            raise ValueError('there is no global map yet: no pair of maps is accepted')
        return str(write_map(self._config.map_directory, self._global, 'global_map'))

    def _reset(self) -> str:
        """Forget all verdicts."""
        self._session.reset()
        return 'all verdicts are forgotten'


def _outcome(job: Callable[[], str]) -> tuple[bool, str]:
    """Do a service's job; tell whether it went well, and what came of it."""
    try:
        return True, job()
    except (OSError, ValueError) as error:
        return False, str(error)


def main(args: list[str] | None = None) -> int:
    """Run fusion_node until SIGINT or SIGTERM."""
    return run(lambda stop: FusionNode(), args)


if __name__ == '__main__':
    raise SystemExit(main())
