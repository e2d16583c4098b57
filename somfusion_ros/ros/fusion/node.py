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

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import write_map
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import names, parameters, qos
from somfusion_ros.ros.common.diagnostics import Faults
from somfusion_ros.ros.common.runtime import run
from somfusion_ros.ros.common.worker import Worker
from somfusion_ros.ros.fusion.departed_link import DepartedLink
from somfusion_ros.ros.fusion.discovery import Discovery
from somfusion_ros.ros.fusion.publisher import FusionPublisher
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.status import fusion_statuses
from somfusion_ros.ros.fusion.team_link import TeamLink
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.inbox import Inbox
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.sightings import Sightings
from std_srvs.srv import Trigger

REPORT_PERIOD = 1.0   # [s] between two diagnostics
DRAWING_SHARE = 4.0   # at most one part in so many of the time goes into drawing the global map


class FusionNode(Node):
    """The ROS side of one robot's part in the team."""

    def __init__(self) -> None:
        super().__init__('fusion_node')
        self._config = parameters.declare(self, FusionNodeConfig)
        team = parameters.declare(self, TeamConfig)
        self._fusion = parameters.declare(self, FusionConfig, changeable=True)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._name = (self._config.robot_name or self.get_namespace()).strip('/')
        if not self._name:
            raise ValueError('fusion_node in the root namespace cannot tell its robot from the '
                             'others: start it in a namespace (--ros-args -r __ns:=/robot1) or '
                             'set the parameter robot_name')
        self._count = Faults(self.get_logger())
        self._session = FusionSession(self._name, team, self._fusion,
                                      self.get_logger().info)
        self._inbox = Inbox(self._name, self._session, self._config.max_map_cells, self._count,
                            time.monotonic)
        self._sightings = Sightings(self._name, self._inbox.heard, self._session.take_sighting,
                                    self._count)
        self._receiver = Receiver(self._inbox, self._sightings, self._config.max_map_cells,
                                  self._count)
        self._global: Grid | None = None
        self._draw_due = 0.0
        self._worker = Worker(self._work, lambda error: self._count('worker_errors', repr(error)))
        self._make_interfaces()
        self._worker.start()

    def close(self, timeout: float) -> bool:
        """Stop the worker; return whether it ended in time."""
        return self._worker.close(timeout)

    def _make_interfaces(self) -> None:
        """Make every topic, service and timer; all but the peers' names are relative."""
        config, waiting = self._config, MutuallyExclusiveCallbackGroup()
        self._publisher = FusionPublisher(self, self._name, config)
        self._link = TeamLink(self, self._receiver, self._count)
        self._departed = DepartedLink(self, self._receiver)
        self._discovery = Discovery(self, self._name, config, self._link,
                                    self._receiver)
        self.create_subscription(PoseWithCovarianceStamped, names.ROBOT_POSE,
                                 partial(self._receiver.on_pose, self._name), qos.STREAM)
        self.create_subscription(Path, names.PATH, self._receiver.on_path, qos.LATEST)
        self.create_subscription(PoseWithCovarianceStamped, names.ENCOUNTERS,
                                 self._receiver.on_sighting, qos.STREAM)
        jobs = {names.MERGE: self._merge, names.SAVE_MAP: self._save, names.RESET: self._reset}
        for name, job in jobs.items():
            self.create_service(Trigger, name, partial(self._serve, job),
                                callback_group=waiting)
        steady = Clock(clock_type=ClockType.STEADY_TIME)   # a paused simulation must not stop it
        self.create_timer(1.0 / config.discovery_rate, self._discover, clock=steady)
        self.create_timer(1.0 / config.merging_rate, self._publish_transforms, clock=steady)
        self.create_timer(REPORT_PERIOD, self._report, clock=steady)

    def _discover(self) -> None:
        """Listen to every robot that is new, and to the maps that are of use."""
        self._discovery.look()
        snapshot = self._session.snapshot
        self._link.want(snapshot.wanted & self._discovery.teams)
        self._departed.offer(snapshot.departed_maps)
        self._departed.fetch(snapshot.sources)

    def _work(self) -> bool:
        """Do one piece of work in the worker; return whether there is more."""
        self._take_messages()
        self._sightings.settle(time.monotonic())
        snapshot = self._session.refresh(self._discovery.present)
        self._link.say(snapshot.constraints, snapshot.departed, time.monotonic())
        self._link.flush()
        self._draw()
        return self._session.attempt(time.monotonic()) is not None

    def _take_messages(self) -> None:
        """Use all that arrived; offer the robot's own map to the peers where it changed."""
        own = self._inbox.drain()
        if own is not None:
            self._publisher.learned(self._session.learned_own(), self._session.placed_peers())
            self._link.share(own)

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
        self._publisher.transforms(self._session.snapshot, self._inbox.heard,
                                   self._discovery.alive)
        poses = self._inbox.heard[self._name].poses
        if poses:
            self._link.tell_pose(poses[-1], self._config.map_frame)

    def _report(self) -> None:
        """Publish the status of the node and of each peer."""
        self._publisher.diagnostics(fusion_statuses(
            self.get_fully_qualified_name().lstrip('/'), self._name, self._session.snapshot,
            self._inbox.heard, self._count.counts(), time.monotonic(), self._config.peer_timeout))

    def _on_parameters(self, changes: list[Any]) -> Any:
        """Apply live changes of the parameters of the merge, all or none."""
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
        self._take_messages()
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
    """Run the job of a service; return whether it went well, and its result or the reason."""
    try:
        return True, job()
    except (OSError, ValueError) as error:
        return False, str(error)


def main(args: list[str] | None = None) -> int:
    """Run fusion_node until SIGINT or SIGTERM."""
    return run(lambda stop: FusionNode(), args)


if __name__ == '__main__':
    raise SystemExit(main())
