# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What comes in from the robot itself and from its peers, until the worker has time for it.

Of every topic of every robot only the newest message is kept, so that no peer can fill the memory
however fast it sends. What is bad is counted under the robot's name and changes nothing.
"""

from collections.abc import Callable
import time
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names
from somfusion_ros.ros.common.heard import Heard, TimedPose
from somfusion_ros.ros.common.peers import robot_of
from somfusion_ros.ros.fusion.team_messages import (bytes_from_message, clusters_from_message,
                                                    state_from_message)
from somfusion_ros.team.graph import Edge
from somfusion_ros.team.map_codec import MapDecoder
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import Cells, FARTHEST, mark_driven, SharedMap
from std_msgs.msg import String

# How the topics are called in diagnostics.
FAULTS = {names.TEAM_STATE: 'state', names.TEAM_MAP: 'map', names.TEAM_MAP_CHANGES: 'map',
          names.RELATIVE_TRANSFORMS: 'transform'}
MOST_TRANSFORMS = 64     # that wait for the worker


class Inbox:
    """Keeps the newest of everything, and hands it to the session."""

    def __init__(self, name: str, session: FusionSession, max_cells: int,
                 count: Callable[..., None]) -> None:
        self.heard: dict[str, Heard] = {}
        self._name, self._session, self._max_cells = name, session, max_cells
        self._count = count
        self._waiting: dict[tuple[str, str], Any] = {}
        self._decoders: dict[str, MapDecoder] = {}
        self._path: Path | None = None

    def keep(self, robot: str, topic: str, message: Any) -> None:
        """Keep a message until the worker takes it."""
        size = len(getattr(message, 'data', ()))
        self.heard[robot].hear(topic, size, time.monotonic())
        self._waiting[robot, topic] = message

    def keep_path(self, message: Path) -> None:
        """Keep the robot's own path."""
        self._path = message

    def keep_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        """Keep a robot's pose in its own map."""
        heard = self.heard[robot]
        heard.hear('pose', 0, time.monotonic())
        try:
            pose = convert.pose_from_message(message.pose.pose)
            covariance = convert.usable_covariance(message.pose.covariance)
            if max(abs(pose.x), abs(pose.y)) > FARTHEST:
                raise ValueError(f'{pose.x:.3g}, {pose.y:.3g} is too far for a map')
        except ValueError as error:
            self._count(f'pose_of_{robot}_unusable', str(error))
            return
        heard.add_pose(TimedPose(convert.seconds(message.header.stamp), pose, covariance))

    def keep_transform(self, owner: str, message: TransformStamped) -> None:
        """Keep what a robot without a state accepted, one transform per other robot."""
        self.heard[owner].hear(names.RELATIVE_TRANSFORMS, 0, time.monotonic())
        peer = robot_of(message.child_frame_id)
        waiting = sum(topic.startswith(names.RELATIVE_TRANSFORMS)
                      for _, topic in list(self._waiting))
        if peer not in ('', owner) and waiting < MOST_TRANSFORMS:
            self._waiting[owner, f'{names.RELATIVE_TRANSFORMS}/{peer}'] = message

    def drain(self) -> Cells | None:
        """Pass all that came to the session; return the robot's own map where it changed."""
        own: Cells | None = None
        takers: dict[str, Callable[[str, Any], Cells | None]] = {
            names.TEAM_STATE: self._take_state, names.CLUSTERS: self._take_clusters,
            names.RELATIVE_TRANSFORMS: self._take_transform}
        for robot, topic in list(self._waiting):
            if topic != names.TEAM_STATE and time.monotonic() < self.heard[robot].taken_until:
                continue   # it waits until one robot only uses the name
            message = self._waiting.pop((robot, topic))
            is_transform = topic.startswith(names.RELATIVE_TRANSFORMS)
            kind = names.RELATIVE_TRANSFORMS if is_transform else topic
            try:
                cells = takers.get(kind, self._take_map)(robot, message)
            except ValueError as error:
                self._count(f'{FAULTS.get(kind, kind)}_of_{robot}_unusable', str(error))
            else:
                own = cells if robot == self._name and cells is not None else own
        return own

    def _take_map(self, robot: str, message: Any) -> Cells | None:
        """Use a map, whole or as part of a stream; return its cells where it changed anything."""
        if isinstance(message, OccupancyGrid):
            whole = convert.cells_from_message(message, self._max_cells)
            cells: Cells | None = mark_driven(whole, self._places(robot))
        else:
            decoder = self._decoders.setdefault(robot, MapDecoder(self._max_cells))
            cells = decoder.decode(bytes_from_message(message))
        if cells is None:
            return None
        shared = SharedMap.from_cells(cells)
        if not shared.grid.known.any():
            raise ValueError('grid is all unknown')
        return cells if self._session.take_map(robot, shared, time.monotonic()) else None

    def _places(self, robot: str) -> list[tuple[float, float]]:
        """Where a robot has been, in its own map: its corrected path, or what its poses said."""
        if robot == self._name and self._path is not None:
            return [(p.pose.position.x, p.pose.position.y) for p in self._path.poses]
        return list(self.heard[robot].trail)

    def _take_state(self, robot: str, message: String) -> None:
        """Use what a peer accepts."""
        state, now = state_from_message(message), time.monotonic()
        if not self.heard[robot].begin(state.session, now):
            raise ValueError(f'two robots are called {robot}; neither is listened to')
        self._session.take_state(robot, state.edges, state.kept)

    def _take_transform(self, owner: str, message: TransformStamped) -> None:
        """Use a pair that a robot without a state accepted; its covariance is not published."""
        self._session.add_edge(owner, Edge(owner, robot_of(message.child_frame_id),
                                           convert.transform_from_message(message),
                                           convert.usable_covariance(np.zeros(36))))

    def _take_clusters(self, robot: str, message: Any) -> None:
        """Use the clusters of a peer's map."""
        self._session.take_clusters(robot, clusters_from_message(message))
