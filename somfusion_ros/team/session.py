# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The work of a fusion node on a live team: maps in, verdicts and the global map out.

Nothing here knows a message or a clock; all of it runs in one worker thread. What other threads
need is handed out as snapshots that never change.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.config import TeamConfig
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.departed import DepartedRobots
from somfusion_ros.team.elastic_session import ElasticSession
from somfusion_ros.team.global_drawing import GlobalDrawing
from somfusion_ros.team.hanging import Hanging
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.jumps import Jumps
from somfusion_ros.team.jumps import TUNING as JUMPS
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.members import Team
from somfusion_ros.team.pausing import pause_after
from somfusion_ros.team.presence import impossible, Presence
from somfusion_ros.team.scouting import Scouting
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.state_codec import TeamState
from somfusion_ros.team.words import begun, LAPSED, sentence
from somfusion_ros.team.world import anchor_of, anchored, WorldWatch

ELASTIC = ''    # in place of a robot's name: what is drawn of views


class FusionSession:
    """
    One robot's team, its verdicts and its global map.

    elastic: what views add; path (n, 3): the own views in the own map as it is now, if known. What
    is wrong is counted under a name, with a reason.
    """

    def __init__(self, name: str, config: TeamConfig, fusion: FusionConfig,
                 say: Callable[[str], object], clock: Callable[[], float] = lambda: 0.0,
                 matchers: Matchers = Matchers(),
                 count: Callable[[str, str], object] = lambda kind, reason: None) -> None:
        known = {robot: Pose(*pose) for robot, pose in config.known_poses().items()}
        self.fusion = fusion
        self._cache, self._matchers, self.snapshot = FusionCache(), matchers, Snapshot()
        self._name, self._config, self._say, self._count = name, config, say, count
        self._team = Team(name, config.minimum_change, known if config.known_init_poses else {},
                          matchers)
        self._departed = DepartedRobots(self._team)
        self.scouting = Scouting(config.minimum_change, self._cache, matchers)
        self._looked: dict[str, float] = {}
        self._words: dict[str, str] = {}
        self._dropped: set[tuple[tuple[str, str], str]] = set()
        self.presence, self._jumps = Presence(), Jumps()
        self._world = WorldWatch(name, JUMPS.distance, JUMPS.heading, say)
        self._drawing = GlobalDrawing(config.robot_radius, say)
        self.elastic = ElasticSession(name, clock, say, matchers)
        self._hanging, self._spoke = Hanging(name, clock), {name}
        self.path: Array | None = None
        self.refresh()

    def shown_maps(self) -> dict[str, SharedMap]:
        """Return the maps of all robots, as they are shown in the global map."""
        return dict(self._team.shown)

    def learned_of(self, robot: str) -> LearnedMap:
        """Return what is learned of a robot's map, which is known."""
        return learn(self._team.maps[robot].grid, self.fusion, self._cache)

    @property
    def own_grid(self) -> Grid | None:
        """The robot's own newest map."""
        return own.grid if (own := self._team.maps.get(self._name)) else None

    def placed_peers(self) -> list[tuple[LearnedMap, Pose]]:
        """Return what was learned of the maps of accepted peers, each with T_own_peer."""
        return [(self.learned_of(peer), pose)
                for peer, pose in self._team.own_transforms().items() if peer in self._team.maps]

    @property
    def absent(self) -> frozenset[str]:
        """Robots that are gone, of whom somebody still knows the map."""
        return self._team.absent

    def epoch_of(self, robot: str) -> Epoch | None:
        """Return which map a robot has now, or had last; None where nobody told."""
        return self._team.epochs.get(robot)

    def begin(self, robot: str, epoch: Epoch, now: float, keep_map: bool = False,
              given: Epoch | None = None) -> bool:
        """Note which map a robot has now, and had at its given pose; return whether it is new."""
        before, old = self._team.begun[robot], self._team.epochs.get(robot)
        self._team.known.bind(robot, given or epoch)
        if not self._team.begin(robot, epoch, keep_map):
            return False
        back = bool(old and old.same_map(epoch))
        pause = pause_after(before, back)
        self._looked[robot] = now + pause
        self.scouting.look_again(robot)
        self.presence.forget(None if robot == self._name else robot)
        for peer in [] if back else self._jumps.peers() if robot == self._name else [robot]:
            self._jumps.forget(peer)
            self._words.pop(peer, None)
        self._say(begun(robot, str(epoch), before + 1, pause, back))
        return True

    def take_map(self, robot: str, shared: SharedMap, lent: bool = False) -> bool:
        """Update a robot's map, or what others lend of it; return whether it changed anything."""
        try:
            return self._team.update_map(robot, shared, lent)
        except ValueError:
            self._departed.refuse(robot)
            raise

    def take_state(self, owner: str, state: TeamState) -> None:
        """Replace all that a peer accepts, and what it knows of robots; note where they were."""
        self._spoke.add(owner)
        self.presence.believe(owner, self._name, state.whereabouts)
        self._team.hear(owner, state.constraints)
        self._departed.hear(owner, state.departed, state.seal)
        self._team.known.hear(owner, state.denied)
        self.elastic.hear_refuted(owner, state.refuted)

    def add_constraint(self, owner: str, constraint: MapConstraint) -> None:
        """Add one pair that a peer accepted, beside those that it told before."""
        first, second = (self._team.epochs.get(robot) for robot in constraint.robots)
        if first is not None and second is not None:
            others = [old for old in self._team.heard_of(owner)
                      if old.robots != constraint.robots]
            self._team.hear(owner, [*others, replace(constraint, epochs=(first, second))])

    def look_around(self, heard: Mapping[str, Heard]) -> None:
        """Note what views show of where other robots were then, if lasers see robots."""
        if self._config.robots_visible:
            self.presence.look(self.elastic.views_of(tuple(heard), self._team.epochs),
                               self._name, heard)

    def take_sighting(self, constraint: MapConstraint) -> None:
        """Add a sighting of a peer."""
        self._team.sight(constraint)

    def peers(self) -> list[str]:
        """Return the robots whose map is known beside the robot's own."""
        return self._team.peers()

    def attempt(self, now: float, force: bool = False) -> str | None:
        """Match the one pair that is due most; return the peer's name, None if none is due."""
        period = 0.0 if force else 1.0 / self._config.estimation_rate
        peer = next((peer for peer in self._team.peers()
                     if now - self._looked.get(peer, -np.inf) >= period
                     and self._look(peer, now, force)), None)
        if peer is None:
            return self.scouting.look(self.own_grid, self.snapshot.wanted, self.fusion, now)
        target, source = self._team.grids_of(peer)
        found = self._matchers.align(target, source, self.fusion, self._cache)
        why = self.presence.why_not(peer, found, self._team)
        verdict = impossible(found, why) if why else self.elastic.weigh(
            peer, found, self._team.epochs, self.fusion.estimation_confidence)
        self._words[peer] = self._team.record(peer, verdict, target, source, now, bool(why))
        self._jumps.look(peer, self._team.own_transforms().get(peer))
        self._say(f'{self._name} and {peer}: '
                  f'{sentence(self._words[peer], verdict.reason, *sorted((self._name, peer)))}')
        return peer

    def refresh(self, present: Collection[str] | None = None) -> Snapshot:
        """Place all maps anew by what is known now, and by who is there, if that is given."""
        for owner, lie in self._departed.update(present) if present is not None else ():
            self._count(f'state_of_{owner}_contradicts_absent', lie)
        self._jumps.keep(self._team.epochs)
        for robot in self._team.known.lapsed(self._team.epochs):
            self._count(f'initial_pose_of_{robot}_lapsed', LAPSED.format(robot=robot))
        solution, pairs = self._team.solution(), self._team.pairs
        mute = {*self._team.maps, *self._team.epochs} - self._spoke | self._team.absent
        for author, doubt in self._hanging.update(solution, mute):
            self._count(f'joined_by_{author}_alone', doubt)
        dropped = {(d.constraint.robots, d.constraint.kind): d.reason for d in solution.dropped}
        for new in [key for key in dropped if key not in self._dropped]:
            self._say(dropped[new])
        self._dropped = set(dropped)
        group, anchor = solution.group_of(self._name), self._config.world_anchor
        refuted = self.elastic.refute(self._team.own_transforms(), self._team.epochs)
        for peer in refuted.keys() - {*self.snapshot.refuted}:
            self._count(f'bonds_of_{peer}_refuted', refuted[peer])
        placed = self._bent(anchored(group, anchor), anchor_of(group, anchor))
        self._world.look(placed, anchor_of(group, anchor))
        self.snapshot = Snapshot(
            self.elastic.seen(self._team.own_transforms(), placed),
            tuple(self._team.own_constraints()), solution,
            {peer: pair.last for peer, pair in pairs.items() if pair.last is not None},
            dict(self._words),
            frozenset({peer for peer, pair in pairs.items() if pair.settled}
                      | self.scouting.unlikely - self._team.maps.keys()),
            frozenset(self.scouting.likely | group.keys() - {self._name}),
            self._departed.known,
            self._departed.maps(), dict(self._departed.sources), self._jumps.count, anchor,
            self._world.changes,
            frozenset(peer for peer, pair in pairs.items() if pair.held and pair.doubted),
            self._team.epochs.get(self._name), dict(self._team.begun), placed,
            self.presence.whereabouts(self._name, self._team.epochs), tuple(refuted),
            self._team.known.given(self._name), self._team.known.denied(self._team.epochs),
            {**self._hanging.doubtful, **refuted, **self._departed.lies})
        return self.snapshot

    def _bent(self, world: dict[str, Pose], anchor: str) -> dict[str, Pose]:
        """Return T_world_map by robot, where views tell more than the verdicts with them."""
        self.elastic.update(world, self._team.epochs, anchor, self._team.accepted())
        places = self.elastic.places(self.path)
        return {robot: places.get(robot, pose) for robot, pose in world.items()}

    def draw(self) -> Grid | None:
        """Draw the global map; None where it would look like the last one."""
        shown, world = self._team.shown, self.snapshot.world(self._name)
        bent = self.elastic.draw()
        if bent is not None:
            rigid = {name: T for name, T in world.items() if name not in self.elastic.solved}
            shown, world = {**shown, ELASTIC: bent}, {**rigid, ELASTIC: Pose()}
        return self._drawing.draw(shown, world, self._name, self.snapshot.own_transforms)

    def forget(self, robot: str) -> None:
        """Forget how a robot stood with this one, which is heard no more; its map may stay."""
        self._departed.forget(robot)
        self._spoke.discard(robot)
        self._looked.pop(robot, None)
        self._words.pop(robot, None)
        self.scouting.forget(robot)

    def reset(self) -> None:
        """Forget all verdicts and begin again."""
        self._team.reset()
        self._looked, self._words = {}, {}
        self.refresh()

    def _look(self, peer: str, now: float, force: bool) -> bool:
        """Note that a pair is looked at, and return whether it is due."""
        self._looked[peer] = now
        due, held = self._team.is_due(peer, now), self._team.pairs[peer].held
        return bool(force or due or held and self.presence.why_not(peer, held, self._team))
