# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What comes in from the robot itself and from its peers, until the worker has time for it.

Of every channel of every robot few messages are kept, unread, so that no peer can fill the memory
however fast it sends. What is bad is counted under the robot's name and changes
nothing; what speaks of a map that is not known to live yet waits. Messages of any kind are handed
in with what reads them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import CHANGES, CLUSTERS, MAP, PLAIN_MAP, STATE, TRANSFORMS
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.heard import check_pose, Heard, TimedPose
from somfusion_ros.team.hearsay import odd_times, oddities
from somfusion_ros.team.map_codec import epoch_of, MapDecoder, number_of
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.plain_epochs import PlainEpochs, PlainMap
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells, mark_driven, SharedMap
from somfusion_ros.team.state_codec import TeamState
from somfusion_ros.team.unread import Unread, Waiting

FAULTS = {STATE: 'state', MAP: 'map', CHANGES: 'map', TRANSFORMS: 'transform'}   # in diagnostics
MOST_TRANSFORMS = 64     # of one plain robot that wait for the worker


class TimedClusters(NamedTuple):
    """The clusters of a robot's map, and their stamp [ns]."""

    clusters: Clusters
    stamp: int


class NotYet(Exception):
    """A message speaks of a map that is not known to be the robot's present one."""


class Inbox:
    """
    Keeps the newest of everything, and hands it to the session.

    Clocks [s]: a steady one, and the one that stamps messages, which is not always known.
    """

    def __init__(self, name: str, session: FusionSession, max_cells: int,
                 count: Callable[..., None], clock: Callable[[], float],
                 stamps: Callable[[], float] = lambda: float('nan')) -> None:
        self.heard: dict[str, Heard] = {}
        self.plain = PlainEpochs()
        self.name, self._session, self._max_cells = name, session, max_cells
        self._count, self._clock, self._stamps = count, clock, stamps
        self._unread = Unread()
        self._decoders: dict[str, MapDecoder] = {}
        self._lent: set[str] = set()     # robots whose map others have told
        self._gone: list[str] = []       # who is heard no more, for the worker to forget
        self._since: dict[str, int] = {}
        self._path: list[tuple[float, float]] | None = None
        self.own: MapCells | None = None     # the robot's own newest map,
        self._news: MapCells | None = None   # where it was not handed out yet

    def keep(self, robot: str, channel: str, message: Any, size: int,
             read: Callable[[Any], Any], rank: int = 0) -> None:
        """
        Keep a message of a size [bytes] until the worker takes it.

        One that overtook it on the way, with a higher rank, stays where nobody has read it yet.
        read makes of it: a TeamState, the bytes of a map or of changes, TimedClusters, a
        PlainMap, or the pose and covariance of a plain robot's transform.
        """
        self._of(robot).hear(channel, size, self._clock())
        self._unread.keep(robot, channel, Waiting(message, read, rank))

    def keep_path(self, places: list[tuple[float, float]]) -> None:
        """Keep where the robot itself has been [m], in its own map."""
        self._path = places

    def keep_pose(self, robot: str, read: Callable[[], tuple[TimedPose, Epoch | None]]) -> None:
        """Read a robot's pose at once; one in another than its present map is nowhere."""
        heard = self._of(robot)
        heard.hear('pose', 0, self._clock())
        try:
            item, epoch = read()
            check_pose(item)
        except ValueError as error:
            self._count(f'pose_of_{robot}_unusable', str(error))
            return
        if robot != self.name:
            own, now = self.heard[self.name], self._clock()
            heard.late = -own.after(item.stamp, now)
            for odd in odd_times((robot, self.name), item.stamp, heard.late,
                                 own.future(item.stamp, now), self._stamps()):
                self._count(*odd)
        if epoch is None or epoch == self._session.epoch_of(robot):
            heard.add_pose(item._replace(arrived=self._clock()))
            if robot != self.name and robot in self.heard:
                self._session.presence.hear(robot, item, self.heard[self.name], self._clock())

    def keep_transform(self, owner: str, peer: str, message: Any,
                       read: Callable[[Any], tuple[Pose, Array]]) -> None:
        """Keep what a robot without a state accepted, one transform per other robot."""
        if peer not in ('', owner) and self._unread.count(owner, TRANSFORMS) < MOST_TRANSFORMS:
            self.keep(owner, f'{TRANSFORMS}/{peer}', message, 0, read)

    def forget(self, robot: str) -> None:
        """Forget a robot that is gone, and all that waits of it."""
        self.heard.pop(robot, None)
        self._unread.forget(robot)
        self.plain.forget(robot)
        self._session.presence.forget(robot)
        self._gone.append(robot)

    def drain(self) -> MapCells | None:
        """Hand all that came to the session; return the own map where it or its epoch changed."""
        while self._gone:
            self._forget(self._gone.pop())
        for robot, epoch, keep_map in self.plain.changed(self._clock()):
            self._begin(robot, epoch, keep_map)
            if robot == self.name and keep_map:
                self._news = self.own     # as that of its epoch
        self._give_back()
        for robot, channel in self._unread.addresses():
            if robot not in self.heard:
                self._unread.forget(robot)
            elif channel == STATE or self._clock() >= self._of(robot).taken_until:
                self._read(robot, channel)     # else it waits until one robot only uses the name
        news, self._news = self._news, None
        return news

    def _read(self, robot: str, channel: str) -> None:
        """Read what waits of a channel, and use it."""
        for waiting in self._unread.take(robot, channel):
            try:
                cells = self._take(robot, channel, waiting.read(waiting.message))
            except NotYet:
                self._unread.keep_early(robot, channel, waiting)
            except ValueError as error:
                kind = channel.partition('/')[0]
                self._count(f'{FAULTS.get(kind, kind)}_of_{robot}_unusable', str(error))
            else:
                self._news = cells if robot == self.name and cells is not None else self._news

    def _forget(self, robot: str) -> None:
        """Forget what was read of a robot that is gone."""
        for record in (self._decoders, self._since):
            record.pop(robot, None)
        self._lent.discard(robot)
        self._session.forget(robot)

    def _of(self, robot: str) -> Heard:
        """Return what was heard of a robot; of one that was forgotten meanwhile, nothing."""
        return self.heard.get(robot) or Heard()

    def _take(self, robot: str, channel: str, content: Any) -> MapCells | None:
        """Hand the content of one message to the session; return cells of a map that changed."""
        if channel == STATE:
            self._take_state(robot, content)
        elif channel == CLUSTERS:
            self._take_clusters(robot, content)
        elif channel == PLAIN_MAP:
            return self._take_plain(robot, content)
        elif channel.startswith(TRANSFORMS):
            self._session.add_constraint(robot, MapConstraint(
                robot, robot_name(channel.removeprefix(f'{TRANSFORMS}/')), *content))
        else:
            return self._take_stream(robot, content)
        return None

    def _take_plain(self, robot: str, content: PlainMap) -> MapCells | None:
        """Accept a whole map, as SLAM publishes it; return its cells where it changed anything."""
        own = self._path if robot == self.name else None
        places = list(self._of(robot).trail) if own is None else own
        cells = mark_driven(content.cells, places)
        shared = SharedMap.showing(cells)
        epoch = self.plain.epoch(robot, content.loaded, shared.grid, self._clock())
        if epoch is None:
            raise NotYet
        self._begin(robot, epoch)
        changed = self._session.take_map(robot, shared)
        self.own = cells if changed and robot == self.name else self.own
        return cells if changed else None

    def _take_stream(self, robot: str, message: bytes) -> MapCells | None:
        """Accept a part of the stream of a map; return its cells where it changed anything."""
        if epoch_of(message) != self._session.epoch_of(robot):
            raise NotYet
        decoder = self._decoders.setdefault(robot, MapDecoder(self._max_cells))
        if decoder.is_stale(message):
            raise NotYet
        lent = not number_of(message)
        if lent and robot not in self._session.absent:
            return None   # it is back, and speaks for itself
        cells = decoder.decode(message)
        if cells is None:
            return None
        changed = self._session.take_map(robot, SharedMap.showing(cells), lent)
        self._lent = self._lent | {robot} if lent else self._lent - {robot}
        return cells if changed else None

    def _give_back(self) -> None:
        """Show robots that are back as they told themselves last, not as others did."""
        for robot in sorted(self._lent - self._session.absent):
            self._lent.discard(robot)
            decoder = self._decoders.get(robot)
            own = None if decoder is None else decoder.own
            if own is not None and own[0] == self._session.epoch_of(robot):
                self._session.take_map(robot, SharedMap.showing(own[1]))

    def _take_state(self, robot: str, state: TeamState) -> None:
        """Accept what a peer accepted, unless something newer came before it."""
        heard = self._of(robot)
        before = heard.session
        if not heard.begin(state.session, self._clock()):
            raise ValueError(f'two robots are called {robot}; neither is listened to')
        if state.session != before and robot in self._decoders:
            self._decoders[robot].restart()
        if not heard.newer(state.number):
            self._count(f'state_of_{robot}_late', 'it came again, or after a newer one')
            return
        for odd in oddities(robot, state, self.name, self.heard):
            self._count(*odd)
        if state.epoch is not None:
            self._begin(robot, state.epoch, given=state.given)
        self._since[robot] = state.since
        self._session.take_state(robot, state)

    def _take_clusters(self, robot: str, content: TimedClusters) -> None:
        """Accept the clusters of a peer's present map."""
        if robot not in self._since:
            raise NotYet
        if content.stamp >= self._since[robot]:
            self._session.scouting.update(robot, content.clusters)

    def _begin(self, robot: str, epoch: Epoch, keep_map: bool = False,
               given: Epoch | None = None) -> None:
        """Note which map a robot has; where it is another one, its old poses are nowhere."""
        known = self._session.epoch_of(robot) is not None
        if self._session.begin(robot, epoch, self._clock(), keep_map, given):
            self._of(robot).forget_poses()
        elif known:
            return
        decoder = self._decoders.get(robot)     # others had told of another map, or of none
        if decoder and decoder.newest and decoder.newest[0] == epoch:
            self._session.take_map(robot, SharedMap.showing(decoder.newest[1]))
