# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Matches between robots: the views of one against local maps of the other.

A view is matched as a loop of one robot is (`slam.loop_matching`): what four views saw together
against the surface that nine views of the peer saw, around where the joint solution has them.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, Array, between
from somfusion_ros.settings import tuned
from somfusion_ros.slam import loop_matching
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loops import Candidate
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_set import ViewSet


@dataclass(frozen=True)
class MatchingSettings:
    """How views are matched with a peer's."""

    every: int = tuned(2, 'views', 'of the source one in so many is matched; four are matched '
                       'together', 'shared teams: each and every 4th do as well')
    most: int = tuned(96, 'views', 'that are matched, spread over those that lie near the '
                      'target', 'Intel and CSAIL: as good as three times as many')
    reach: float = tuned(4.0, 'm', 'between the surfaces that two views saw, at most',
                         'shared teams: 6 m is no better')
    candidates: int = tuned(2, 'places', 'of the peer that a view is matched against',
                            'shared teams: 3 are no better')
    apart: int = tuned(10, 'views', 'between two such places', 'shared teams')


@dataclass(frozen=True)
class Rounds:
    """How far from where they lie views are sought, round by round."""

    sigmas: tuple[tuple[float, float], ...] = tuned(
        ((0.5, 0.06), (0.15, 0.03), (0.05, 0.015)), 'm, rad',
        'within which views are sought; one near round alone misses bent places', 'shared teams')


@dataclass(frozen=True, eq=False)
class Placed:
    """Views of one robot at their poses (n, 3) in the world."""

    name: str
    views: ViewSet
    poses: Array

    @property
    def seen(self) -> Array:
        """Centres (n, 2) [m] of what the views saw, in the world."""
        c, s = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        x, y = self.views.centres.T
        seen: Array = self.poses[:, :2] + np.column_stack([c * x - s * y, s * x + c * y])
        return seen


class Surroundings:
    """Local maps around a robot's views at their poses in the world, made when asked for."""

    def __init__(self, placed: Placed) -> None:
        self._placed = placed
        self._made: dict[int, LocalMap] = {}

    def __call__(self, view: int) -> LocalMap:
        """Local map around a view, in its frame."""
        if view not in self._made:
            placed = self._placed
            self._made[view] = loop_matching.local_map(
                view, range(len(placed.views)), placed.poses, placed.views.clouds)
        return self._made[view]


def match_views(target: Placed, source: Placed, sigma: tuple[float, float],
                settings: MatchingSettings, config: SlamConfig) -> list[InterMatch]:
    """Match the source's views with the target's, expected within sigma [m] [rad]."""
    around, found = Surroundings(target), []
    for new, places in spread(target, source, settings.every, settings.most, settings):
        seen = loop_matching.recent(new, range(new + 1), source.poses, source.views.clouds)
        for old in places:
            expected = between(target.poses[old], source.poses[new])
            candidate = Candidate(old, expected, np.array([sigma[0], sigma[0], sigma[1]]))
            loop = loop_matching.match(candidate, new, seen, around, config)
            if loop is not None:
                found.append(InterMatch(target.name, old, source.name, new, loop.constraint.z,
                                        loop.constraint.R))
    return found


def spread(target: Placed, source: Placed, every: int, most: int, settings: MatchingSettings
           ) -> list[tuple[int, list[int]]]:
    """Choose source views that lie near the target, evenly, with the target views there."""
    near = [(new, places) for new in range(0, len(source.views), every)
            if (places := nearest(target, source, new, settings))]
    chosen = np.unique(np.linspace(0, len(near) - 1, min(most, len(near))).round().astype(int))
    return [near[k] for k in chosen]


def nearest(target: Placed, source: Placed, new: int, settings: MatchingSettings) -> list[int]:
    """Return the target views whose surface lies nearest to that of source view `new`."""
    centre = apply(source.poses[new], source.views.centres[new][None])
    distance = np.hypot(*(target.seen - centre).T)
    distance += 0.5 * np.hypot(*(target.poses[:, :2] - source.poses[new, :2]).T)
    chosen: list[int] = []
    for old in np.argsort(distance, kind='stable'):
        if len(chosen) == settings.candidates or distance[old] > settings.reach:
            break
        if all(abs(int(old) - c) >= settings.apart for c in chosen):
            chosen.append(int(old))
    return chosen
