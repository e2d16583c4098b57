# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The elastic map of a live team, on one robot: views and bonds in, places and the global map out.

It has no say in who belongs together: verdicts on the grids, weighed with the views, decide that.
Where the views of a robot did not come, as of one with another SLAM, its map is laid rigidly.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond_codec import encode_bonds
from somfusion_ros.team.gliding import Glide
from somfusion_ros.team.joint_drawing import JointDrawing
from somfusion_ros.team.kept_views import encode_kept
from somfusion_ros.team.matchers import Matchers
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.told_bonds import Epochs, Pairs, ToldBonds
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.view_store import ViewStore
from somfusion_ros.team.view_verdict import could_matter, judge_views, RULES


@dataclass(frozen=True)
class LiveTuning:
    """How often the team's problem is solved, and how its solution is drawn."""

    digits: int = tuned(4, 'digits', 'of the poses that are drawn and published [m, rad], so that '
                        'all robots draw alike', 'by design')
    resolution: float = tuned(0.05, 'm', 'of the map that is drawn of views', 'by design')
    share: float = tuned(10.0, '', 'solving the whole takes one part in so many of the time at '
                         'most, going on from the last solution another, drawing all a third',
                         'by design')
    soonest: float = tuned(2.0, 's', 'between two solutions', 'by design')
    astray: float = tuned(4.0, 'm', 'from where the accepted pairs have the maps, in the median, '
                          'a bond counts for nothing; honest maps bend by up to 2 m', 'by design')
    misplaced: float = tuned(1.0, 'm', 'from where the own map lies in that of a peer, in the '
                             'median, its bond is false, if the views match nowhere; maps bend',
                             'by design')
    mismatched: float = tuned(0.4, 'm', 'from where the own views match those of a peer, in the '
                              'median, its bond is false; honest ones differ by 0.28 m at most, '
                              'of paths of which the other one knew 40 % to all', 'mines, wean')


TUNING = LiveTuning()
MOST_ROBOTS = 64


class ElasticSession:
    """One robot's views and bonds of its team, and what follows from them."""

    def __init__(self, name: str, clock: Callable[[], float],
                 say: Callable[[str], object] = lambda text: None,
                 matchers: Matchers = Matchers()) -> None:
        self._name, self._clock, self._matchers = name, clock, matchers
        self._stores: dict[str, ViewStore] = {}
        self._bonds = ToldBonds(name, matchers.reader)
        self._glide = Glide(say)
        self._solved_for: Any = None
        self._joined: Any = None
        self._anchor, self.solutions = '', 0
        self._solved_epochs: dict[str, Epoch] = {}
        self._solved: dict[str, Array] = {}
        self._hurried = False     # the whole is still to be solved for what is known
        self._drawing = JointDrawing(TUNING.resolution, TUNING.share, clock, matchers.draw, say,
                                     name)
        self._solved_views: dict[str, ViewSet] = {}
        self._due = self._whole_due = 0.0

    def take_views(self, robot: str, batch: bytes) -> bool:
        """Add what a robot told of its path, as a ViewStore does; ValueError if unusable."""
        if robot not in self._stores and len(self._stores) >= MOST_ROBOTS:
            raise ValueError(f'views of more than {MOST_ROBOTS} robots')
        return self._stores.setdefault(robot, ViewStore(self._matchers.reader)).take(batch)

    def take_bonds(self, author: str, data: bytes) -> None:
        """Replace the bonds that a peer tells; ValueError where they are unusable."""
        self._bonds.take(author, data)

    def own_bonds(self) -> bytes:
        """Return the bonds that this robot tells."""
        return self._bonds.bytes_of(self._name) or encode_bonds(())

    def bytes_of(self, robot: str) -> int:
        """Return how many bytes a robot told of its path."""
        return self._stores[robot].bytes if robot in self._stores else 0

    def kept(self, robot: str) -> bytes:
        """Return all that a robot told, as those who come later get it; empty if nothing."""
        batches = self._stores[robot].batches if robot in self._stores else []
        return encode_kept(batches, self._bonds.bytes_of(robot)) if batches else b''

    def weigh(self, peer: str, verdict: Alignment, epochs: Epochs, confidence: float) -> Alignment:
        """
        Weigh a verdict on the grids with the views of both robots, where they have come.

        Of the pair, the map of the first name is the target. What joins them is kept.
        """
        target, source = sorted((self._name, peer))
        views = self.views_of((target, source), epochs)
        if (len(views) < 2 or verdict.T_target_source is None
                or not could_matter(verdict.probability, confidence)):
            return verdict
        bond, rival = self._matchers.bond(views, target, source, verdict.T_target_source), None
        if verdict.runner_up is not None and verdict.probability < RULES.clear:
            rival = self._matchers.rival(bond, views, verdict.runner_up.T_target_source)
        judged = judge_views(verdict, bond, rival, confidence)
        self._bonds.keep(peer, bond, judged.accepted, epochs)
        return judged

    def refute(self, T_own_peer: Mapping[str, Pose], epochs: Epochs) -> dict[str, str]:
        """Return the accepted peers whose bonds the own views contradict, with sentences."""
        found = self._bonds.refute(self.views_of((self._name, *T_own_peer), epochs), T_own_peer,
                                   epochs, TUNING.misplaced, TUNING.mismatched)
        return {peer: f'{peer} tells matches of views that are {off:.1f} m from where those of '
                      f'{self._name} match' for peer, off in sorted(found.items())}

    def hear_refuted(self, owner: str, peers: Collection[str]) -> None:
        """Replace the peers whose bonds with it a robot calls false."""
        self._bonds.refuted[owner] = frozenset(peers)

    def views_of(self, robots: tuple[str, ...], epochs: Epochs) -> dict[str, ViewSet]:
        """Return the views of those robots that told them of their present maps."""
        found = {}
        for robot in robots:
            store = self._stores.get(robot)
            if store is not None and store.epoch is not None and store.epoch == epochs.get(robot):
                views = store.views()
                if len(views):
                    found[robot] = views
        return found

    def update(self, world: Mapping[str, Pose], epochs: Epochs, anchor: str,
               accepted: Pairs | None = None) -> None:
        """
        Solve the team's problem where something is new and it is time to.

        world: T_world_map by robot of the connected group, as the verdicts have it; epochs: which
        map every robot has now; anchor: the robot whose map stays, at best, where it is; accepted:
        which robot accepts its pair with which other one, without which no bond counts.
        """
        views = self.views_of(tuple(sorted(world)), epochs)
        bonds = self._bonds.counting(views, world, epochs, accepted, TUNING.astray)
        if len(views) < 2 or not bonds:
            self._glide.aim({}, None)
            self._solved_for = None
            return
        world = {name: Pose(*np.round(world[name], TUNING.digits)) for name in views}
        key = ({name: id(one) for name, one in views.items()}, anchor, world,
               {(bond.target, bond.source): bond.matches for bond in bonds})
        group = anchor, tuple((name, str(epochs[name])) for name in sorted(views))
        if anchor != self._anchor:
            self._solved_for, self._anchor = None, anchor      # all lies elsewhere now
        self._glide.keep(name for name in views if self._solved_epochs.get(name) == epochs[name])
        if self._solve(key, (group, {(bond.target, bond.source) for bond in bonds}),
                       lambda: self._matchers.join(views, world, bonds, anchor),
                       lambda: self._matchers.go_on(views, world, bonds, anchor, self._solved)):
            self._solved_views = views
            self._solved_epochs = {name: epochs[name] for name in views}
            self._glide.aim(self._solved, group)
        elif self._drawing.drawn is self._glide.shown:     # else the last step was not shown yet
            self._glide.step(self._clock())

    def _solve(self, key: Any, joined: Any, whole: Callable[[], dict[str, Array]],
               go_on: Callable[[], dict[str, Array]]) -> bool:
        """
        Solve the problem named by a key where it is time to; return whether it was.

        The whole is solved when its share of the time allows, so that in the end all robots have
        the same. Meanwhile, as long as the same are joined, a step or two lead on from the last
        solution.
        """
        start, new = self._clock(), key != self._solved_for
        if self._solved_for is None or ((new or self._hurried) and start >= self._whole_due):
            poses = whole()
            self._hurried = False
            self._whole_due, self._due = start + self._pause(start), start + TUNING.soonest
        elif new and joined == self._joined and start >= self._due:
            poses = go_on()
            self._hurried, self._due = True, start + self._pause(start)
        else:
            return False
        self._solved = {name: np.round(one, TUNING.digits) for name, one in poses.items()}
        self._solved_for, self._joined = key, joined
        self.solutions += 1
        return True

    def _pause(self, start: float) -> float:
        """Return how long [s] after its start the next one like what just ended may begin."""
        return max(TUNING.soonest, TUNING.share * (self._clock() - start))

    def places(self, path: Array | None) -> dict[str, Pose]:
        """
        Return T_world_map by robot that has each right where it is now; {} if unsolved.

        path (n, 3): the views of this robot in its own map as it is now, where that is known.
        """
        found = {}
        for robot, poses in self._glide.shown.items():
            own, last = self._solved_views[robot].poses, len(poses) - 1
            if robot == self._name and path is not None and len(path) > last:
                own = path
            found[robot] = Pose.from_array(compose(poses[last], inverse(own[last])))
        return found

    def own_path(self) -> tuple[Array, Array] | None:
        """Return stamps (m,) [s] of the own views and where they are shown (m, 3) in the world."""
        shown = self._glide.shown.get(self._name)
        return None if shown is None else (self._solved_views[self._name].stamps, shown)

    def told_pose(self, pose: Pose, path: Array | None) -> Pose:
        """Return where the robot is in its map as its views are told; path: as it shows them."""
        views = self._solved_views.get(self._name)
        if self._name not in self._glide.shown or views is None or path is None or not len(path):
            return pose
        last = min(len(path), len(views)) - 1
        return Pose.from_array(compose(views.poses[last], between(path[last], pose)))

    def seen(self, peers: Mapping[str, Pose], placed: Mapping[str, Pose]) -> dict[str, Pose]:
        """Return T_own_peer by peer, of placed maps, as the views have them where they came."""
        bent = {*self.solved} if self._name in self._glide.shown else set()
        return {peer: Pose.from_array(between(placed[self._name], placed[peer]))
                if peer in bent else pose for peer, pose in peers.items()}

    def draw(self) -> SharedMap | None:
        """Draw the views of all that are solved; None without a solution, the same while it is."""
        shown = self._glide.shown
        return self._drawing.draw(self._solved_views, shown) if shown else None

    @property
    def solved(self) -> list[str]:
        """Robots whose views lie in the solution."""
        return sorted(self._glide.shown)

    @property
    def shown(self) -> dict[str, ViewSet]:
        """Views that lie in the solution, by robot."""
        return dict(self._solved_views) if self._glide.shown else {}
