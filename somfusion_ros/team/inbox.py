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
from somfusion_ros.team.heard import TUNING as HEARING
from somfusion_ros.team.hearsay import oddities
from somfusion_ros.team.map_codec import epoch_of, MapDecoder, number_of
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.plain_epochs import PlainEpochs, PlainMap
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.shared_map import MapCells, mark_driven, SharedMap
from somfusion_ros.team.state_codec import TeamState
from somfusion_ros.team.unread import Unread, Waiting

FAULTS = {STATE: 'state', MAP: 'map', CHANGES: 'map', TRANSFORMS: 'transform'}   # in diagnostics
MOST_TRANSFORMS = 64     # that wait for the worker


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
        self.own: MapCells | None = None     # the robot's own newest map

    def keep(self, robot: str, channel: str, message: Any, size: int,
             read: Callable[[Any], Any], rank: int = 0) -> None:
        """
        Keep a message of a size [bytes] until the worker takes it.

        One that overtook it on the way, with a higher rank, stays where nobody has read it yet.
        read makes of it: a TeamState, the bytes of a map or of changes, TimedClusters, a
        PlainMap, or the pose and covariance of a plain robot's transform.
        """
        self.heard[robot].hear(channel, size, self._clock())
        self._unread.keep(robot, channel, Waiting(message, read, rank))

    def keep_path(self, places: list[tuple[float, float]]) -> None:
        """Keep where the robot itself has been [m], in its own map."""
        self._path = places

    def keep_pose(self, robot: str, read: Callable[[], tuple[TimedPose, Epoch | None]]) -> None:
        """Read a robot's pose at once; one in another than its present map is nowhere."""
        heard = self.heard[robot]
        heard.hear('pose', 0, self._clock())
        try:
            item, epoch = read()
            check_pose(item)
        except ValueError as error:
            self._count(f'pose_of_{robot}_unusable', str(error))
            return
        if robot != self.name:
            self._compare_clocks(robot, item.stamp)
        if epoch is None or epoch == self._session.epoch_of(robot):
            heard.add_pose(item._replace(arrived=self._clock()))
            if robot != self.name:
                self._session.presence.hear(robot, item, self.heard[self.name], self._clock())

    def _compare_clocks(self, robot: str, stamp: float) -> None:
        """Count a peer's clock that is ahead of the robot's own, and poses that come late."""
        own, now = self.heard[self.name], self._clock()
        late, ahead = -own.after(stamp, now), own.future(stamp, now)
        self.heard[robot].late = late
        if late > HEARING.tardy:
            self._count(f'pose_of_{robot}_late', f'by {late:.1f} s: a slow network, or its clock')
        if ahead and stamp <= self._stamps() + HEARING.ahead:
            self._count(f'pose_of_{self.name}_late', f'by {ahead:.1f} s: the own SLAM is slow')
        elif ahead:
            self._count(f'clock_of_{robot}_ahead', f'by {ahead:.1f} s: it was set, or drifts')

    def keep_transform(self, owner: str, peer: str, message: Any,
                       read: Callable[[Any], tuple[Pose, Array]]) -> None:
        """Keep what a robot without a state accepted, one transform per other robot."""
        if peer not in ('', owner) and self._unread.count(TRANSFORMS) < MOST_TRANSFORMS:
            self.keep(owner, f'{TRANSFORMS}/{peer}', message, 0, read)

    def forget(self, robot: str) -> None:
        """Forget a robot that is gone, and all that waits of it."""
        self._unread.forget(robot)
        for record in (self.heard, self._decoders, self._since):
            record.pop(robot, None)
        self._lent.discard(robot)
        self.plain.forget(robot)
        self._session.presence.forget(robot)
        self._gone.append(robot)

    def drain(self) -> MapCells | None:
        """Hand all that came to the session; return the own map where it or its epoch changed."""
        own: MapCells | None = None
        while self._gone:
            self._session.forget(self._gone.pop())
        for robot, epoch, keep_map in self.plain.changed(self._clock()):
            self._begin(robot, epoch, keep_map)
            own = self.own if robot == self.name and keep_map else own   # as that of its epoch
        self._give_back()
        for robot, channel in self._unread.addresses():
            if channel != STATE and self._clock() < self.heard[robot].taken_until:
                continue   # it waits until one robot only uses the name
            for waiting in self._unread.take(robot, channel):
                try:
                    cells = self._take(robot, channel, waiting.read(waiting.message))
                except NotYet:
                    self._unread.keep_early(robot, channel, waiting)
                except ValueError as error:
                    kind = channel.partition('/')[0] if channel.startswith(TRANSFORMS) else channel
                    self._count(f'{FAULTS.get(kind, kind)}_of_{robot}_unusable', str(error))
                else:
                    own = cells if robot == self.name and cells is not None else own
        return own

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
        places = list(self.heard[robot].trail) if own is None else own
        cells = mark_driven(content.cells, places)
        shared = _shared(cells)
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
        changed = self._session.take_map(robot, _shared(cells), lent)
        self._lent = self._lent | {robot} if lent else self._lent - {robot}
        return cells if changed else None

    def _give_back(self) -> None:
        """Show robots that are back as they told themselves last, not as others did."""
        for robot in sorted(self._lent - self._session.absent):
            self._lent.discard(robot)
            decoder = self._decoders.get(robot)
            own = None if decoder is None else decoder.own
            if own is not None and own[0] == self._session.epoch_of(robot):
                self._session.take_map(robot, _shared(own[1]))

    def _take_state(self, robot: str, state: TeamState) -> None:
        """Accept what a peer accepted, unless something newer came before it."""
        before = self.heard[robot].session
        if not self.heard[robot].begin(state.session, self._clock()):
            raise ValueError(f'two robots are called {robot}; neither is listened to')
        if state.session != before and robot in self._decoders:
            self._decoders[robot].restart()
        if not self.heard[robot].newer(state.number):
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
            self.heard[robot].forget_poses()
        elif known:
            return
        decoder = self._decoders.get(robot)     # others had told of another map, or of none
        if decoder and decoder.newest and decoder.newest[0] == epoch:
            self._session.take_map(robot, _shared(decoder.newest[1]))


def _shared(cells: MapCells) -> SharedMap:
    """Return the map of cells; ValueError where they show nothing."""
    shared = SharedMap.from_cells(cells)
    if not shared.grid.known.any():
        raise ValueError('grid is all unknown')
    return shared
