# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the views of two robots say of their maps: do they belong together, and how bent."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, Array, between, compose, fit
from somfusion_ros.settings import tuned
from somfusion_ros.team.confirming import Confirmation
from somfusion_ros.team.inter_matching import Placed
from somfusion_ros.team.joint_problem import InterMatch


@dataclass(frozen=True)
class BondSettings:
    """When two robots' maps may bend one another."""

    consistent: float = tuned(16.3, '', 'squared Mahalanobis distance of a match that counts as '
                              'one: 99.9 % of chi-square with 3 degrees', 'by design')
    fewest: int = tuned(3, 'matches', 'that join two maps', 'by design')
    confirmed: float = tuned(0.75, '', 'share of the views that must confirm', 'shared teams')
    near: float = tuned(0.01, 'm', 'sigma below which nothing more is said of it', 'by design')
    fixed: float = tuned(0.1, 'm', 'sigma of the weakest direction that matches must reach',
                         'shared teams')
    resolution: float = tuned(0.05, 'm', 'of the maps whose walls are compared', 'by design')
    same: float = tuned(1.0, 'm', 'between where two bonds put the same views, of one place',
                        'mines, live')
    worse: float = tuned(0.005, '', 'share by which walls may agree less than before; a map that '
                         'is drawn anew differs by as much', 'parts of mines and wean')


@dataclass(frozen=True, eq=False)
class Bond:
    """
    What the views say of a pair of robots.

    matches that agree with the solution; views asked and confirmed; sigma [m] of the direction
    that the matches fix least; how far [m] one map is bent against the other at most; the share
    of walls that agree before and after, NaN where the maps hardly overlap. holds: whether the
    matches take part in the team's solution; the reason says why, or why not.
    """

    target: str
    source: str
    matches: tuple[InterMatch, ...]
    confirmation: Confirmation
    weakest: float
    bend: float
    before: float
    after: float
    holds: bool
    reason: str

    @property
    def pair(self) -> tuple[str, str]:
        """Names of target and source."""
        return self.target, self.source

    @property
    def gain(self) -> float:
        """Share by which more walls agree than before; NaN where the maps hardly overlap."""
        return self.after - self.before


def weakest_direction(matches: Sequence[InterMatch], source: Array, floor: Array) -> float:
    """
    Return sigma [m] of the direction in which matches fix two robots least against one another.

    source (n, 3): the poses of the source's views in the world; floor (3, 3): covariance of every
    match besides its own. Infinite without a match.
    """
    if not matches:
        return float('inf')
    placed = source[[m.source_view for m in matches]]
    z = np.array([m.z for m in matches])
    x, y = (placed[:, :2] - placed[:, :2].mean(0)).T
    theta = placed[:, 2] - z[:, 2]     # of the target's views in the world
    c, s = np.cos(theta), np.sin(theta)
    J = np.zeros((len(matches), 3, 3))     # of a match in a motion of the source about its middle
    J[:, 0], J[:, 1] = np.array([c, s, x * s - y * c]).T, np.array([-s, c, x * c + y * s]).T
    J[:, 2, 2] = 1.0
    information = np.linalg.inv(np.array([m.R for m in matches]) + floor)
    H = (J.transpose(0, 2, 1) @ information @ J).sum(0) + 1e-9 * np.eye(3)
    return float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv(H)[:2, :2])[-1]))


def bend(matches: Sequence[InterMatch], target: Placed, source: Placed) -> float:
    """
    Return how far [m] the joint solution bent two maps against one another, at most.

    The best rigid transform of the source's own map onto the target's leaves this much of where
    the matched views lie at the solution.
    """
    if len(matches) < 2:
        return 0.0
    a, b = [m.target_view for m in matches], [m.source_view for m in matches]
    solved = compose(target.views.poses[a], between(target.poses[a], source.poses[b]))[:, :2]
    own = source.views.poses[b][:, :2]
    return float(np.hypot(*(apply(fit(own, solved), own) - solved).T).max())
