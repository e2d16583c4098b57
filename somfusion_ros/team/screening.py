# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Is a match likely? Asked of a peer's clusters alone, before its whole map goes over the network.

The search is that of a match, with the robot's own whole map as the target. A pose counts by the
peer's walls that it lays on own walls, and against it count those that it lays on space known to
be free; what the peer saw free is not known yet, so the answer is no verdict. Chosen to miss no
pair that the verdict accepts; where it errs, a map is sent for nothing
(benchmarks/team/screening.py).
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.alignment import ALIGNMENT
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import LEARNING, recall
from somfusion_ros.fusion.scoring import tally
from somfusion_ros.fusion.search import search
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.geometry import place
from somfusion_ros.settings import tuned

BUDGET = 640          # clusters that a robot tells of its map: 19 kB


@dataclass(frozen=True)
class ScreeningTuning:
    """When a match is likely: missed ones are lost, false ones cost a map that is sent."""

    margin: float = tuned(
        1.25, '', 'a match is likely if the best pose is so many times better than the next',
        'benchmarks/team/screening.py on the shared pairs')
    ratio: float = tuned(
        0.85, '', 'or if this share of the walls that can be judged agrees',
        'benchmarks/team/screening.py on the shared pairs')
    least: float = tuned(
        6.0, 'm', 'and in any case this length of wall',
        'benchmarks/team/screening.py on the shared pairs')


TUNING = ScreeningTuning()


@dataclass(frozen=True)
class Screening:
    """Share of walls that agree, their length [m], how many times better than the next pose."""

    ratio: float = 0.0
    matched: float = 0.0
    margin: float = 1.0

    @property
    def likely(self) -> bool:
        """Whether the whole maps are worth sending."""
        return self.matched >= TUNING.least and (self.margin >= TUNING.margin
                                                 or self.ratio >= TUNING.ratio)


def outline(learned: LearnedMap, budget: int = BUDGET) -> Clusters:
    """Return clusters that stand for a map: all, or an even choice of a budget."""
    clusters = learned.clusters
    if len(clusters) <= budget:
        return clusters
    return clusters.take(np.linspace(0, len(clusters) - 1, budget).astype(np.intp))


def screen(own: LearnedMap, clusters: Clusters, config: FusionConfig | None = None) -> Screening:
    """Compare the robot's own map with a peer's clusters."""
    oriented = int(np.count_nonzero(clusters.straight > LEARNING.oriented))
    if min(len(own.features), oriented) < ALIGNMENT.fewest_features:
        return Screening()
    poses = search(own, recall(clusters, own.resolution), config or FusionConfig(),
                   Stopwatch()).poses
    matched, against = tally(own.zones.at(place(poses, clusters.centres)), clusters)
    ratio = matched / (matched + against + 1.0)
    score = ratio * np.sqrt(matched)
    order = np.argsort(-score)
    best, next_score = order[0], score[order[1]] if len(order) > 1 else 0.0
    return Screening(float(ratio[best]), float(matched[best]),
                     float(score[best] / max(next_score, 1e-3)))
