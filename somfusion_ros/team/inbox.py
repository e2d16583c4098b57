# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What comes in from the robot itself and from its peers, until the worker has time for it.

Of every channel of every robot only the newest message is kept, unread, so that no peer can fill
the memory however fast it sends. What is bad is counted under the robot's name and changes
nothing. Messages of any kind are handed in with what reads them.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.team.channels import CHANGES, CLUSTERS, MAP, STATE, TRANSFORMS
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.map_codec import MapDecoder
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells, mark_driven, SharedMap, TUNING
from somfusion_ros.team.state_codec import decode_state

FAULTS = {STATE: 'state', MAP: 'map', CHANGES: 'map', TRANSFORMS: 'transform'}   # in diagnostics
MOST_TRANSFORMS = 64     # that wait for the worker


class Waiting(NamedTuple):
    """A message that nobody has read yet, and what reads it or raises ValueError."""

    message: Any
    read: Callable[[Any], Any]


class Inbox:
    """Keeps the newest of everything, and hands it to the session."""

    def __init__(self, name: str, session: FusionSession, max_cells: int,
                 count: Callable[..., None], clock: Callable[[], float]) -> None:
        self.heard: dict[str, Heard] = {}
        self._name, self._session, self._max_cells = name, session, max_cells
        self._count, self._clock = count, clock
        self._waiting: dict[tuple[str, str], Waiting] = {}
        self._decoders: dict[str, MapDecoder] = {}
        self._path: list[tuple[float, float]] | None = None

    def keep(self, robot: str, channel: str, message: Any, size: int,
             read: Callable[[Any], Any]) -> None:
        """
        Keep a message of a size [bytes] until the worker takes it.

        read makes of it: the text of a state, the bytes of a map or of changes, Clusters, MapCells
        of a plain map, or the pose and covariance of a plain robot's transform.
        """
        self.heard[robot].hear(channel, size, self._clock())
        self._waiting[robot, channel] = Waiting(message, read)

    def keep_path(self, places: list[tuple[float, float]]) -> None:
        """Keep where the robot itself has been [m], in its own map."""
        self._path = places

    def keep_pose(self, robot: str, read: Callable[[], TimedPose]) -> None:
        """Read a robot's pose in its own map at once."""
        heard = self.heard[robot]
        heard.hear('pose', 0, self._clock())
        try:
            item = read()
            if max(abs(item.pose.x), abs(item.pose.y)) > TUNING.farthest:
                raise ValueError(f'{item.pose.x:.3g}, {item.pose.y:.3g} is too far for a map')
        except ValueError as error:
            self._count(f'pose_of_{robot}_unusable', str(error))
            return
        heard.add_pose(item)

    def keep_transform(self, owner: str, peer: str, message: Any,
                       read: Callable[[Any], tuple[Pose, Array]]) -> None:
        """Keep what a robot without a state accepted, one transform per other robot."""
        waiting = sum(channel.startswith(TRANSFORMS) for _, channel in list(self._waiting))
        if peer not in ('', owner) and waiting < MOST_TRANSFORMS:
            self.keep(owner, f'{TRANSFORMS}/{peer}', message, 0, read)

    def drain(self) -> MapCells | None:
        """Hand all that came to the session; return the robot's own map where it changed."""
        own = None
        for robot, channel in list(self._waiting):
            if channel != STATE and self._clock() < self.heard[robot].taken_until:
                continue   # it waits until one robot only uses the name
            waiting = self._waiting.pop((robot, channel))
            try:
                cells = self._take(robot, channel, waiting.read(waiting.message))
            except ValueError as error:
                kind = channel.partition('/')[0] if channel.startswith(TRANSFORMS) else channel
                self._count(f'{FAULTS.get(kind, kind)}_of_{robot}_unusable', str(error))
            else:
                own = cells if robot == self._name and cells is not None else own
        return own

    def _take(self, robot: str, channel: str, content: Any) -> MapCells | None:
        """Hand the content of one message to the session; return cells of a map that changed."""
        if channel == STATE:
            self._take_state(robot, content)
        elif channel == CLUSTERS:
            self._take_clusters(robot, content)
        elif channel.startswith(TRANSFORMS):
            self._session.add_constraint(robot, MapConstraint(
                robot, channel.removeprefix(f'{TRANSFORMS}/'), *content))
        else:
            return self._take_map(robot, content)
        return None

    def _take_map(self, robot: str, content: MapCells | bytes) -> MapCells | None:
        """Take a map, whole or as part of a stream; return its cells where it changed anything."""
        cells: MapCells | None
        if isinstance(content, MapCells):
            cells = mark_driven(content, self._places(robot))
        else:
            decoder = self._decoders.setdefault(robot, MapDecoder(self._max_cells))
            cells = decoder.decode(content)
        if cells is None:
            return None
        shared = SharedMap.from_cells(cells)
        if not shared.grid.known.any():
            raise ValueError('grid is all unknown')
        return cells if self._session.take_map(robot, shared, self._clock()) else None

    def _places(self, robot: str) -> Iterable[tuple[float, float]]:
        """Where a robot has been, in its own map: its corrected path, or what its poses said."""
        if robot == self._name and self._path is not None:
            return self._path
        return list(self.heard[robot].trail)

    def _take_state(self, robot: str, text: str) -> None:
        """Take what a peer accepts."""
        state = decode_state(text)
        if not self.heard[robot].begin(state.session, self._clock()):
            raise ValueError(f'two robots are called {robot}; neither is listened to')
        self._session.take_state(robot, state.constraints, state.departed)

    def _take_clusters(self, robot: str, clusters: Clusters) -> None:
        """Take the clusters of a peer's map."""
        self._session.take_clusters(robot, clusters)
