# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Two robots' views: match them, solve, confirm, and compare the walls with before.

From where a verdict on the grids has the maps, views are matched in rounds, from wide to near,
each from the poses that the last round solved. The bond holds only if the views confirm the
solution, the matches fix all directions, and walls agree no worse than before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.bond import bend, Bond, BondSettings, weakest_direction
from somfusion_ros.team.confirming import confirm, Confirmation, ConfirmSettings
from somfusion_ros.team.inter_matching import match_views, MatchingSettings, Placed, Rounds
from somfusion_ros.team.joint import solve_joint
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.joint_problem import InterMatch, JointSettings
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.wall_agreement import wall_agreement


@dataclass(frozen=True)
class ElasticSettings:
    """How a team's maps become one: the settings of every step."""

    rounds: Rounds = field(default_factory=Rounds)
    matching: MatchingSettings = field(default_factory=MatchingSettings)
    joint: JointSettings = field(default_factory=JointSettings)
    confirming: ConfirmSettings = field(default_factory=ConfirmSettings)
    bond: BondSettings = field(default_factory=BondSettings)


def bond_of(views: Mapping[str, ViewSet], target: str, source: str, T_target_source: Pose,
            settings: ElasticSettings | None = None) -> Bond:
    """
    Ask the views of two robots whether the source's map lies at a pose in the target's.

    Parameters
    ----------
    views : of both robots, by name
    target, source : their names
    T_target_source : where the source's map lies about
    settings : of every step
    """
    problem = _Pair(views, target, source, T_target_source, settings or ElasticSettings())
    matches, poses = problem.matched()
    return problem.judged(matches, poses)


def rival_of(bond: Bond, views: Mapping[str, ViewSet], T_target_source: Pose,
             settings: ElasticSettings | None = None) -> Bond | None:
    """
    Ask the views of a pair about another pose; None where they lead to the same place.

    Of bent maps the grids may fit in two ways, each in another part: the views bend both into one.
    """
    settings = settings or ElasticSettings()
    rival = bond_of(views, *bond.pair, T_target_source, settings)
    own = views[bond.target].poses
    here, there = ({m.source_view: compose(own[m.target_view], m.z)[:2] for m in one.matches}
                   for one in (bond, rival))
    both = here.keys() & there.keys()
    apart = [float(np.hypot(*(here[view] - there[view]))) for view in both]
    return None if both and np.median(apart) < settings.bond.same else rival


class _Pair:
    """The problem of two robots, in the target's map frame."""

    def __init__(self, views: Mapping[str, ViewSet], target: str, source: str,
                 T_target_source: Pose, settings: ElasticSettings) -> None:
        self._names = target, source
        self._views = {name: views[name] for name in self._names}
        self._maps = {target: np.zeros(3), source: np.array(T_target_source)}
        self._rigid = {name: compose(self._maps[name], self._views[name].poses)
                       for name in self._names}
        self._settings, self._config = settings, SlamConfig()

    def matched(self) -> tuple[list[InterMatch], dict[str, Array]]:
        """Match in rounds; return the matches that agree with the solution, and the solution."""
        poses, matches = self._rigid, []
        for sigma in self._settings.rounds.sigmas:
            matches = match_views(*self._placed(poses), sigma, self._settings.matching,
                                  self._config)
            if len(matches) < self._settings.bond.fewest:
                return matches, self._rigid
            solution = solve_joint(self._views, matches, self._maps, self._settings.joint)
            poses = solution.poses
        agree = solution.chi2 < self._settings.bond.consistent
        return [m for m, good in zip(matches, agree, strict=True) if good], poses

    def judged(self, matches: list[InterMatch], poses: dict[str, Array]) -> Bond:
        """Judge what was found."""
        settings, (target, source) = self._settings, self._placed(poses)
        bond = Bond(*self._names, tuple(matches), Confirmation(), float('inf'), 0.0, float('nan'),
                    float('nan'), False, f'{len(matches)} views match')
        if len(matches) < settings.bond.fewest:
            return bond
        asked = confirm(target, source, settings.confirming, settings.matching, self._config)
        weakest = weakest_direction(matches, source.poses, settings.joint.floor_covariance)
        size = 'under 1' if weakest < settings.bond.near else f'{100.0 * weakest:.0f}'
        said = (f'{asked.confirmed} of {asked.asked} views confirm, worst direction fixed to '
                f'{size} cm')
        bond = replace(bond, confirmation=asked, weakest=weakest, reason=said,
                       bend=bend(matches, target, source), before=self._agreement(self._rigid),
                       after=self._agreement(poses))
        if bond.gain < -settings.bond.worse:
            return replace(bond, reason=(
                f'{bond.reason}, but walls would agree {100 * bond.after:.0f} % instead of '
                f'{100 * bond.before:.0f} %'))
        return replace(bond, holds=(asked.share >= settings.bond.confirmed
                                    and weakest <= settings.bond.fixed))

    def _placed(self, poses: Mapping[str, Array]) -> tuple[Placed, Placed]:
        """Put the views of both robots at poses."""
        target, source = (Placed(name, self._views[name], poses[name]) for name in self._names)
        return target, source

    def _agreement(self, poses: Mapping[str, Array]) -> float:
        """Return the share of the walls that agree at some poses, as they would be drawn."""
        maps = (draw_joint(self._views, poses, self._settings.bond.resolution, (name,))
                for name in self._names)
        return wall_agreement(*maps)
