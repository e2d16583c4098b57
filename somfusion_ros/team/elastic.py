# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One elastic map out of a team's: match views across robots, solve all together, confirm.

From where the verdicts on the grids have the maps, views are matched in rounds, from wide to
near, each from the poses that the last round solved. A pair takes part only if its views confirm
the solution, its matches fix all directions, and its walls agree no worse than before; otherwise
its maps are laid together rigidly, as the verdict has them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from somfusion_ros.geometry import Array, between, compose, fit, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.bond import bend, Bond, BondSettings, weakest_direction
from somfusion_ros.team.confirming import confirm, Confirmation, ConfirmSettings
from somfusion_ros.team.graph import with_drift
from somfusion_ros.team.inter_matching import match_views, MatchingSettings, Placed, Rounds
from somfusion_ros.team.joint import InterMatch, JointSettings, JointSolution, solve_joint
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.wall_agreement import wall_agreement

Pair = tuple[str, str]


@dataclass(frozen=True)
class ElasticSettings:
    """How a team's maps become one: the settings of every step."""

    rounds: Rounds = field(default_factory=Rounds)
    matching: MatchingSettings = field(default_factory=MatchingSettings)
    joint: JointSettings = field(default_factory=JointSettings)
    confirming: ConfirmSettings = field(default_factory=ConfirmSettings)
    bond: BondSettings = field(default_factory=BondSettings)


@dataclass(frozen=True, eq=False)
class ElasticTeam:
    """Where all views (n, 3) lie in the world, by robot, and what joins each pair."""

    poses: dict[str, Array]
    bonds: tuple[Bond, ...]


def straighten(robots: Mapping[str, ViewSet], world: Mapping[str, Pose],
               config: SlamConfig | None = None, settings: ElasticSettings | None = None
               ) -> ElasticTeam:
    """
    Bend the maps of a connected group so that they fit one another.

    Parameters
    ----------
    robots : views and constraints by robot; those that `world` does not hold are left out
    world : T_world_map by robot, where the accepted pairs have the maps
    config : of the SLAM, for how views are matched
    settings : see `ElasticSettings`
    """
    robots = {name: robots[name] for name in sorted(world) if len(robots.get(name, ()))}
    problem = _Elastic(robots, world, config or SlamConfig(), settings or ElasticSettings())
    matches, poses = problem.matched()
    bonds = [problem.bond(pair, found, poses) for pair, found in matches.items()]
    while True:
        solution = problem.solve([m for b in bonds if b.holds for m in b.matches])
        judged = problem.compared(bonds, solution.poses)
        if sum(b.holds for b in judged) == sum(b.holds for b in bonds):
            return ElasticTeam(solution.poses, tuple(judged))
        bonds = judged


def ask(views: Mapping[str, ViewSet], target: str, source: str, T_target_source: Pose,
        settings: ElasticSettings | None = None) -> Bond:
    """Ask the views of two robots whether the source's map lies at a pose in the target's."""
    pair = {name: views[name] for name in sorted((target, source))}
    world = {target: Pose(), source: T_target_source}
    problem = _Elastic(pair, world, SlamConfig(), settings or ElasticSettings())
    (names, matches), = (found := problem.matched())[0].items()
    return problem.bond(names, matches, found[1])


class _Elastic:
    """One team's problem: its robots' views, and where their maps lie before and after."""

    def __init__(self, robots: Mapping[str, ViewSet], world: Mapping[str, Pose],
                 config: SlamConfig, settings: ElasticSettings) -> None:
        self._robots, self._config, self._settings = robots, config, settings
        self._world = {name: np.array(world[name]) for name in robots}
        self._rigid = {name: compose(self._world[name], robots[name].poses) for name in robots}
        self._pairs = list(combinations(robots, 2))

    def matched(self) -> tuple[dict[Pair, list[InterMatch]], dict[str, Array]]:
        """Match every pair in rounds; return the matches, and all poses as they solve them."""
        poses, matches = self._rigid, {}
        for sigma in self._settings.rounds.sigmas:
            matches = {pair: match_views(*self._placed(pair, poses), sigma,
                                         self._settings.matching, self._config)
                       for pair in self._pairs}
            every = [m for found in matches.values() for m in found]
            solution = self.solve(every)
            poses = solution.poses
        near = iter(solution.chi2 < self._settings.bond.consistent)
        return {pair: [m for m in found if next(near)] for pair, found in matches.items()}, poses

    def solve(self, matches: Sequence[InterMatch]) -> JointSolution:
        """Solve all constraints; groups that no match joins are laid together rigidly."""
        ties = [self._tie(group) for group in _groups(list(self._robots), matches)[1:]]
        solution = solve_joint(self._robots, [*matches, *ties], self._world, self._settings.joint)
        anchor = min(self._robots)
        back = _best_rigid(solution.poses[anchor], self._rigid[anchor])
        return JointSolution({name: compose(back, poses)
                              for name, poses in solution.poses.items()},
                             solution.chi2[:len(matches)])

    def bond(self, pair: Pair, matches: list[InterMatch], poses: dict[str, Array]) -> Bond:
        """Judge a pair by its views."""
        target, source = self._placed(pair, poses)
        settings, asked = self._settings, Confirmation()
        weakest = weakest_direction(matches, source.poses, settings.joint.floor_covariance)
        if len(matches) >= settings.bond.fewest:
            asked = confirm(target, source, settings.confirming, settings.matching, self._config)
        said = (f'{asked.confirmed} of {asked.asked} views confirm, worst direction fixed to '
                f'{"under 1" if weakest < 0.01 else format(100.0 * weakest, ".0f")} cm')
        holds = asked.share >= settings.bond.confirmed and weakest <= settings.bond.fixed
        before = wall_agreement(*(self._rigid_maps[name] for name in pair))
        if len(matches) < settings.bond.fewest:
            said = f'{len(matches)} views match'
        return Bond(*pair, tuple(matches), asked, weakest, bend(matches, target, source),
                    before, float('nan'), holds, said)

    def compared(self, bonds: list[Bond], poses: dict[str, Array]) -> list[Bond]:
        """Tell how well walls agree at the solution; let go of the pair that it harmed most."""
        maps = self._drawn(poses)
        bonds = [replace(b, after=wall_agreement(maps[b.target], maps[b.source])) if b.holds else b
                 for b in bonds]
        worst = min((b for b in bonds if b.holds), key=lambda b: np.nan_to_num(b.gain),
                    default=None)
        if worst is None or not worst.gain < -self._settings.bond.worse:
            return bonds
        reason = (f'{worst.reason}, but walls would agree {100 * worst.after:.0f} % instead of '
                  f'{100 * worst.before:.0f} %')
        return [replace(b, holds=False, reason=reason) if b is worst else b for b in bonds]

    @cached_property
    def _rigid_maps(self) -> dict[str, Grid]:
        """Every robot's map where the verdicts have it."""
        return self._drawn(self._rigid)

    def _drawn(self, poses: Mapping[str, Array]) -> dict[str, Grid]:
        """Every robot's map at poses in the world."""
        return {name: draw_joint(self._robots, poses, self._settings.bond.resolution, (name,))
                for name in self._robots}

    def _placed(self, pair: Pair, poses: Mapping[str, Array]) -> tuple[Placed, Placed]:
        """Put the views of both robots at poses in the world."""
        target, source = (Placed(name, self._robots[name], poses[name]) for name in pair)
        return target, source

    def _tie(self, group: list[str]) -> InterMatch:
        """Lay a group of robots rigidly where the verdicts have it, by one constraint."""
        anchor, robot = min(self._robots), group[0]
        views = len(self._robots[robot]) // 2
        z = between(self._rigid[anchor][0], self._rigid[robot][views])
        R = with_drift(Pose.from_array(z), np.zeros((3, 3)))
        return InterMatch(anchor, 0, robot, views, z, R)


def _groups(names: list[str], matches: Sequence[InterMatch]) -> list[list[str]]:
    """Sort names into groups that matches join, that of the first name first."""
    group = {name: {name} for name in names}
    for m in matches:
        together = group[m.target] | group[m.source]
        group |= dict.fromkeys(together, together)
    return [sorted(one) for one in {min(g): g for g in group.values()}.values()]


def _best_rigid(poses: Array, wanted: Array) -> Array:
    """Return the rigid motion (3,) that brings poses (n, 3) nearest to others (n, 3)."""
    return np.array(fit(_ends(poses), _ends(wanted)))


def _ends(poses: Array) -> Array:
    """Points (2 n, 2) one metre ahead of each pose and behind it."""
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return np.concatenate([poses[:, :2] + ahead, poses[:, :2] - ahead])
