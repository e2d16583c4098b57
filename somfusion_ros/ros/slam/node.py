# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
slam_node: one robot's scans and odometry in, its map, pose and path out.

The callbacks only convert and hand on; the work is done by the threads of `pipeline`.
"""

from collections.abc import Callable
from pathlib import Path
import time
from typing import Any
from uuid import uuid4

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from somfusion_ros.grid import MAX_CELLS
from somfusion_ros.io.frame_names import plain
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.offline.beginning import Beginning, from_map
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, parameters, qos
from somfusion_ros.ros.common.managed import ManagedNode
from somfusion_ros.ros.common.optional_types import message_type
from somfusion_ros.ros.common.runtime import run
from somfusion_ros.ros.common.saved_files import file_stem, requested_name
from somfusion_ros.ros.common.tf import Mounts
from somfusion_ros.ros.slam.joint_path import JointPath
from somfusion_ros.ros.slam.odometry_input import OdometryInput
from somfusion_ros.ros.slam.peer_bodies import PeerBodies
from somfusion_ros.ros.slam.pipeline import Pipeline, TICK
from somfusion_ros.ros.slam.publisher import SlamPublisher
from somfusion_ros.ros.slam.scan_input import ScanInput
from somfusion_ros.ros.slam.sources import hint
from somfusion_ros.ros.slam.status import Last, silence, slam_status
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from std_srvs.srv import SetBool, Trigger

REPORT_PERIOD = 1.0  # [s] between two diagnostics
PATIENCE = 2.0       # [s] for which something may be missing after the start before it is said


class SlamNode(ManagedNode):
    """The ROS side of one robot's SLAM."""

    def __init__(self) -> None:
        super().__init__('slam_node')
        self._config = parameters.declare(self, SlamNodeConfig)
        self._slam_config = parameters.declare(self, SlamConfig, changeable=True)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._last = Last()
        self._pipeline: Pipeline

    def configure(self) -> None:
        """Begin a map, or go on from the state file; create publishers and services."""
        part, config = self.configured_part, self._config
        self._last = Last(reported=(0, time.monotonic()))
        self._publisher = SlamPublisher(part, config)
        state_file = '' if config.mode == 'localization' else config.state_file
        self._keeper = CheckpointKeeper(state_file, config.state_interval, self._count,
                                        self.get_logger().info)
        self._pipeline = Pipeline(self._session_from, self._beginning(), self._keeper,
                                  self._publisher, self._last, self._count,
                                  self.get_logger().info)
        self._pipeline.map_interval = config.map_update_interval
        self.serve(Trigger, names.SAVE_MAP, lambda _: self._save(self._config.map_name))
        self.serve(Trigger, names.SERIALIZE_MAP, self._serialize)
        self.serve(Trigger, names.DESERIALIZE_MAP, self._deserialize)
        self.serve(Trigger, names.RESET, lambda _: self._pipeline.reset())
        self.serve(SetBool, names.PAUSE, self._pause)
        save_map = message_type('nav2_msgs.srv', 'SaveMap')
        if save_map is not None:
            self.serve(save_map, names.SAVE_MAP_AS, lambda r: self._save(requested_name(r)))
        part.create_service(GetMap, names.DYNAMIC_MAP, self._dynamic_map)

    def activate(self) -> None:
        """Listen to the robot, and start the threads."""
        part, config, to = self.active_part, self._config, self._pipeline
        to.start()
        self._mounts = Mounts(part, config.given_mount, self._count)
        self._bodies = PeerBodies(part, config.peer_radius)
        if config.use_peers:
            JointPath(part, self._pipeline.straighten, self._count)
        self._odometry = OdometryInput(part, config, to.add_odometry, to.add_turn, self._count)
        self._scans = ScanInput(part, config.scan_topics, self._on_scan, self._count)
        self._inputs = f'{self._scans.topic}, {self._odometry.topic}'
        part.create_subscription(PoseWithCovarianceStamped, names.INITIAL_POSE,
                                 self._on_initial_pose, qos.LATEST)
        if self._last.awaited:
            part.create_subscription(OccupancyGrid, config.map_topic, self._on_given_map,
                                     qos.LATCHED)
        self.every(TICK, self._pipeline.tick)
        self.every(REPORT_PERIOD, self._report)
        if self._publisher.sends_transforms:
            self.every(config.transform_publish_period, self._send_transform)

    def clean_up(self) -> None:
        """Free the state file for another node."""
        if hasattr(self, '_keeper'):
            self._keeper.close()

    def deactivate(self, timeout: float) -> bool:
        """Stop the threads; return whether they ended in time."""
        return self._pipeline.stop(timeout)

    def submit(self, job: Callable[[], Any]) -> None:
        """Run a job of a service in the thread that draws maps."""
        self._pipeline.submit(job)

    def _beginning(self) -> Beginning:
        """Return the map to start in, if there is one already; ValueError where it is no map."""
        config = self._config
        if config.mode == 'mapping':
            return Beginning(self._keeper.load())
        if config.map_file:
            return from_map(Path(config.map_file).expanduser()).counted(self._count)
        self._last.awaited = f'no map on {self.resolve_topic_name(config.map_topic)} yet'
        return Beginning()

    def _session_from(self, beginning: Beginning) -> Session:
        """Begin a session, in a map if there is one."""
        return Session(self._slam_config, self._config.transform_timeout, self._count,
                       beginning.checkpoint, start=uuid4().hex[:12], how=beginning.start,
                       odometry=self._config.odometry_source != 'none')

    def _on_scan(self, message: Any, laser: str) -> None:
        """Hand on a scan, and where other robots are."""
        self._last.scan_heard = time.monotonic()
        convert.stamp_if_missing(message.header, self.get_clock().now().to_msg(), self._count)
        mount = self._mount_of(message.header.frame_id)
        self._last.heard_stamp = message.header.stamp
        if mount is None:
            self._count('scans_without_mount', self._last.lacking, PATIENCE)
        elif not (self._last.paused or self._last.awaited):
            scan = convert.scan_from_message(message, mount, laser,
                                             self._config.scan_topics.index(laser))
            self._pipeline.add_scan(scan, message.header.stamp, self._bodies.known())

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Believe a pose that was given by hand, in the frame of the map."""
        frame = message.header.frame_id
        if plain(frame) != plain(self._config.map_frame):
            self._count('initialpose_frames', f'a pose in {frame!r} is not used here, only in '
                        f'{self._config.map_frame!r}; fusion_node translates those in world')
            return
        try:
            pose = convert.pose_from_message(message.pose.pose)
            P = convert.usable_covariance(message.pose.covariance)
        except ValueError as error:
            self._count('initialpose_unusable', str(error))
            return
        self._pipeline.relocate(pose, P)

    def _on_given_map(self, message: OccupancyGrid) -> None:
        """Localise in the first map that comes and can be used."""
        if not self._last.awaited:
            return
        try:
            grid = convert.grid_from_message(message, MAX_CELLS)
        except ValueError as error:
            self._count('given_map_unusable', str(error))
            return
        self._last.awaited = ''
        self._pipeline.localize_in(grid)

    def _mount_of(self, laser: str) -> Mount | None:
        """Return the mount of a laser; None, with the reason kept, where there is none to use."""
        base, self._last.lacking = self._config.base_frame, ''
        try:
            mount = self._mounts.find(base, laser)
        except ValueError as error:
            self._last.lacking = str(error)
            return None
        if mount is None and not plain(laser):
            self._last.lacking = ('the scans have no frame_id: set it in the driver of the laser, '
                                  'or set laser_pose')
        elif mount is None:
            self._last.lacking = (f'no transform {base} -> {laser} on /tf_static'
                                  f'{self._mounts.hint(base, laser)}: publish it, or set '
                                  'laser_pose')
        return mount

    def _send_transform(self) -> None:
        """Repeat map -> odom."""
        if self._last.step is not None and self._last.present is not None and self._last.placed:
            self._publisher.transform(self._last.step, self._last.present)

    def _report(self) -> None:
        """Publish the status of the node, and log why nothing comes out."""
        self._scans.look()
        self._last.odometry_heard = self._odometry.heard
        slam = self._pipeline.session.slam
        kind, reason = silence(self._last, time.monotonic(), slam.counters['views'])
        if kind:
            self._last.hint = hint(self, self._config, kind)
            self._count(kind, f'{reason}{self._last.hint} (on {self._inputs})', PATIENCE)
        self._publisher.diagnostics(slam_status(
            self.get_fully_qualified_name().lstrip('/'), self.get_namespace(), self._last, slam,
            self._count.counts(), time.monotonic(), self.without_clock))

    def _on_parameters(self, changes: list[Any]) -> Any:
        """Apply live changes, all or none."""
        config, result = parameters.change(self._config, changes)
        if result.successful:
            self._slam_config, result = parameters.change(self._slam_config, changes)
        if result.successful:
            self._config = config
            if hasattr(self, '_pipeline'):
                self._pipeline.map_interval = config.map_update_interval
                self._pipeline.session.configure(self._slam_config)
        return result

    def _dynamic_map(self, request: Any, response: GetMap.Response) -> GetMap.Response:
        """Answer with the map as published last."""
        response.map = self._pipeline.map or response.map
        return response

    def _save(self, name: str) -> str:
        """Write the map as it is now."""
        return self._pipeline.save_map(self._stem(name))

    def _serialize(self, request: Any) -> str:
        """Write the state, from which SLAM can go on."""
        return self._pipeline.serialize(self._stem(self._config.map_name))

    def _deserialize(self, request: Any) -> str:
        """Go on from a state that was written, in place of the present map."""
        return self._pipeline.deserialize(self._stem(self._config.map_name))

    def _stem(self, name: str) -> Any:
        """Return the path, without ending, of the files of a name."""
        return file_stem(self._config.map_directory, name, self.get_namespace(), names.MAP)

    def _pause(self, request: SetBool.Request) -> str:
        """Leave out new scans, or take them again."""
        self._last.paused = bool(request.data)
        return 'new scans are left out' if request.data else 'new scans are taken again'


def main(args: list[str] | None = None) -> int:
    """Run slam_node until SIGINT or SIGTERM."""
    return run(lambda stop: SlamNode(), args)


if __name__ == '__main__':
    raise SystemExit(main())
