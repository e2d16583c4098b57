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
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.common import names, parameters, qos
from somfusion_ros.ros.common.managed import ManagedNode
from somfusion_ros.ros.common.optional_types import message_type
from somfusion_ros.ros.common.runtime import run
from somfusion_ros.ros.common.saved_files import file_stem, requested_name
from somfusion_ros.ros.common.worker import Worker
from somfusion_ros.ros.fusion.departed_link import DepartedLink
from somfusion_ros.ros.fusion.discovery import Discovery
from somfusion_ros.ros.fusion.frames import Frames, team_prefix
from somfusion_ros.ros.fusion.global_map import GlobalMap
from somfusion_ros.ros.fusion.initial_pose import InitialPose
from somfusion_ros.ros.fusion.own_map import OwnMap
from somfusion_ros.ros.fusion.peer_topics import PeerTopics
from somfusion_ros.ros.fusion.publisher import FusionPublisher
from somfusion_ros.ros.fusion.receiver import Receiver
from somfusion_ros.ros.fusion.status import fusion_statuses, never_seen
from somfusion_ros.ros.fusion.team_link import TeamLink
from somfusion_ros.ros.fusion.view_link import ViewLink
from somfusion_ros.ros.fusion.world_transforms import WorldTransforms
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.inbox import Inbox
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.sightings import Sightings
from somfusion_ros.team.view_ages import ViewAges
from somfusion_ros.team.view_inbox import ViewInbox
from std_msgs.msg import String
from std_srvs.srv import Trigger

REPORT_PERIOD = 1.0   # [s] between two diagnostics
LOOKS_AROUND = 5      # after so many looks for others a robot takes itself for alone


class FusionNode(ManagedNode):
    """The ROS side of one robot's part in the team."""

    def __init__(self) -> None:
        super().__init__('fusion_node')
        self._config = parameters.declare(self, FusionNodeConfig)
        self._team = parameters.declare(self, TeamConfig)
        self._fusion = parameters.declare(self, FusionConfig, changeable=True)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._session: FusionSession

    def configure(self) -> None:
        """Begin with no verdicts; create the publishers for users, and the services."""
        part, config = self.configured_part, self._config
        self._name = (config.robot_name or self.get_namespace()).strip('/')
        self._prefix = team_prefix(self.get_namespace(), self._name)
        self._frames = Frames(self._name, config.map_frame, config.world_frame)
        session = FusionSession(self._name, self._team, self._fusion, self.get_logger().info,
                                time.monotonic, count=self._count)
        self._inbox = Inbox(self._name, session, config.max_map_cells, self._count,
                            time.monotonic, self._stamp)
        self._inbox.heard[self._name] = Heard()
        self._sightings = Sightings(self._name, self._inbox.heard, session.take_sighting,
                                    self._count)
        self._view_inbox = ViewInbox(session.elastic, self._inbox.heard, self._count,
                                     time.monotonic, lambda: session.absent)
        self._session = session
        self._publisher = FusionPublisher(part, self._frames, self._prefix,
                                          config.merged_map_topic)
        self._ages = ViewAges(self._inbox.heard)
        self._global_map = GlobalMap(session, self._publisher, config, self._count, self._age)
        self._transforms = WorldTransforms(part, self._frames, config)
        self._peer_topics = PeerTopics(part, self._frames, session, self._inbox.heard)
        self.serve(Trigger, names.MERGE, lambda _: self._merge())
        self.serve(Trigger, names.SAVE_MAP, lambda _: self._save(self._config.map_name))
        self.serve(Trigger, names.RESET, lambda _: self._reset())
        save_map = message_type('nav2_msgs.srv', 'SaveMap')
        if save_map is not None:
            self.serve(save_map, names.SAVE_MAP_AS, lambda r: self._save(requested_name(r)))

    def activate(self) -> None:
        """Listen to the robot and its peers, and start the thread that works."""
        part, config = self.active_part, self._config
        self._worker = Worker(self._work, self.count_error)
        receiver = Receiver(self._inbox, self._sightings, config.max_map_cells, self._count)
        self._since = time.monotonic()
        self._link = TeamLink(part, self._prefix, receiver, self._count)
        self._views = ViewLink(part, self._prefix, self._name, self._session, self._view_inbox,
                               self._count, self._link.start)
        self._departed = DepartedLink(part, self._prefix, receiver, self._session.elastic,
                                      self._view_inbox)
        self._discovery = Discovery(part, self._prefix, config, self._link, receiver)
        InitialPose(part, self._frames, self._session, self._count)
        OwnMap(part, config, partial(receiver.on_map, self._name), self._count)
        part.create_subscription(String, names.MAP_EPOCH, partial(receiver.on_epoch, self._name),
                                 qos.LATCHED)
        part.create_subscription(PoseWithCovarianceStamped, names.ROBOT_POSE,
                                 partial(receiver.on_pose, self._name), qos.STREAM)
        part.create_subscription(Path, names.PATH, receiver.on_path, qos.LATEST)
        part.create_subscription(PoseWithCovarianceStamped, names.ENCOUNTERS,
                                 receiver.on_sighting, qos.STREAM)
        self.every(1.0 / config.discovery_rate, self._discover)
        self.every(1.0 / config.merging_rate, self._publish_team)
        self.every(REPORT_PERIOD, self._report)
        if self._transforms.period > 0.0:
            self.every(self._transforms.period, self._transforms.send)
        self._worker.start()

    def deactivate(self, timeout: float) -> bool:
        """Stop the thread; return whether it ended in time."""
        return self._worker.close(timeout)

    def submit(self, job: Callable[[], Any]) -> None:
        """Run a job of a service in the thread that works."""
        self._worker.submit(job)

    def _discover(self) -> None:
        """Listen to every robot that is new, and to the maps that are of use."""
        self._discovery.look()
        snapshot = self._session.snapshot
        self._link.want(snapshot.wanted & self._discovery.teams)
        self._views.want(snapshot.wanted & self._discovery.teams, self._inbox.heard)
        self._departed.offer(snapshot.departed_maps, {gone.robot: gone.epoch
                                                      for gone in snapshot.departed})
        self._departed.fetch(snapshot.sources, self._session.absent)
        self._peer_topics.offer(snapshot.connected(self._name))

    def _work(self) -> bool:
        """Do one piece of work in the worker; return whether there is more."""
        self._take_messages()
        self._sightings.settle(time.monotonic())
        snapshot = self._session.refresh(self._discovery.present)
        self._link.say(snapshot, time.monotonic())
        self._link.flush()
        self._views.say()
        self._views.say_joint(self._config.world_frame)
        looked_around = self._discovery.looks >= LOOKS_AROUND
        self._transforms.place(snapshot, self._discovery.alive, looked_around)
        self._global_map.update()
        self._peer_topics.publish()
        return self._session.attempt(time.monotonic()) is not None

    def _take_messages(self) -> None:
        """Use all that arrived; offer the robot's own map to the peers where it changed."""
        self._view_inbox.drain()
        own = self._inbox.drain() or (None if self._link.shares else self._inbox.own)
        self._session.look_around(dict(self._inbox.heard))     # robots come and go meanwhile
        if own is not None:
            self._link.share(own, self._session.epoch_of(self._name) or Epoch())
            self._publisher.learned(self._session.learned_of(self._name),
                                    self._session.placed_peers())

    def _publish_team(self) -> None:
        """Publish what is accepted and where the robots are, also if nothing changed."""
        self._publisher.team(self._session.snapshot, self._inbox.heard,
                             self._discovery.present)
        poses = self._inbox.heard[self._name].poses
        if poses:
            session = self._session
            told = session.elastic.told_pose(poses[-1].pose, session.path)
            self._link.tell_pose(poses[-1]._replace(pose=told), self._config.map_frame)

    def _age(self) -> None:
        """Note how old the views are that the global map shows now."""
        self._ages.note(self._session.elastic.shown, self._stamp())

    def _stamp(self) -> float:
        """Return the time [s] with which messages are stamped now."""
        return 1e-9 * self.get_clock().now().nanoseconds

    def _report(self) -> None:
        """Publish the status of the node and of each peer."""
        now, heard = time.monotonic(), self._inbox.heard
        missing = {name.strip('/') for name in self._config.peers} - heard.keys() - {''}
        for peer in sorted(missing):
            self._count(f'{peer}_never_seen', never_seen(peer), self._config.peer_timeout)
        self._publisher.diagnostics(fusion_statuses(
            self.get_fully_qualified_name().lstrip('/'), self._name, self._session.snapshot,
            heard, self._count.counts(), now, self._config.peer_timeout, missing,
            self.without_clock, self._discovery.present))

    def _on_parameters(self, changes: list[Any]) -> Any:
        """Apply live changes, all or none."""
        config, result = parameters.change(self._config, changes)
        if result.successful:
            self._fusion, result = parameters.change(self._fusion, changes)
        if result.successful:
            self._config = config
            if hasattr(self, '_session'):
                self._session.fusion, self._global_map.config = self._fusion, config
        return result

    def _merge(self) -> str:
        """Match every pair now, whether its maps changed or not."""
        self._take_messages()
        now = time.monotonic()
        for _ in self._session.peers():
            self._session.attempt(now, force=True)
        connected = self._session.refresh().connected(self._name)
        self._global_map.update(force=True)
        return f'connected: {", ".join(connected) or "nobody"}'

    def _save(self, name: str) -> str:
        """Write the global map."""
        stem = file_stem(self._config.map_directory, name, self.get_namespace(),
                         names.GLOBAL_MAP)
        return self._global_map.save(stem)

    def _reset(self) -> str:
        """Forget all verdicts."""
        self._session.reset()
        return 'all verdicts are forgotten'


def main(args: list[str] | None = None) -> int:
    """Run fusion_node until SIGINT or SIGTERM."""
    return run(lambda stop: FusionNode(), args)


if __name__ == '__main__':
    raise SystemExit(main())
