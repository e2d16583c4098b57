# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two learned maps in, distinct poses of one in the other out (sections III-A and III-B)."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion import orientation, scoring, translation, voting
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class SearchSettings:
    """Numbers that the search was tuned with."""

    peaks: int = tuned(
        4, 'peaks', "of the histograms' correlation are followed; the right one is among them in "
        'every shared pair', 'benchmarks/fusion/stages.py')
    candidates: int = tuned(
        40, 'poses', 'distinct, of which the wall cells choose the finalists',
        'benchmarks/fusion/stages.py')
    vote_cells: int = tuned(
        512, 'cells', 'most along an edge of the voting grid: bounds memory and time',
        'benchmarks/fusion/growth.py')
    last_angles: tuple[float, ...] = tuned(
        (9.0, 6.0, 5.0, 4.0), 'deg', 'last thresholds of Algorithm 2, with all clusters',
        'by design')
    last_reaches: tuple[float, ...] = tuned(
        (0.4, 0.3, 0.2, 0.15), 'm', 'furthest match at each of them',
        'benchmarks/fusion/stages.py: strict')


SEARCH = SearchSettings()


def search(target: LearnedMap, source: LearnedMap, config: FusionConfig,
           stopwatch: Stopwatch) -> tuple[Array, Array]:
    """Propose distinct poses (B, 3) of the source, with J of every step, (steps, B)."""
    correlation = orientation.correlate(target.histogram, source.histogram)
    turns = orientation.tune(orientation.peaks(correlation, SEARCH.peaks), target.spectrum,
                             source.spectrum)
    stopwatch.lap('orientation')
    votes = voting.VoteGrid(target.features, source.features, config.vote_cell, SEARCH.vote_cells)
    poses = np.concatenate([votes.seeds(turn, config.seeds).reshape(-1, 3)
                            for turn in orientation.families(turns)])
    stopwatch.lap('seeds')
    poses, _ = translation.settle(poses, source.sketch, target.features, target.nearest)
    score = scoring.scores(poses, target, source, every=2)
    poses = scoring.distinct(poses, score, source.pivot, SEARCH.candidates)
    matched, against = scoring.fine(poses, target, source)
    rank = np.argsort(-matched ** 1.5 / (matched + against + 1.0), kind='stable')
    poses = poses[rank[:config.finalists]]
    poses, J = settle_last(poses, target, source, sketch=False)
    stopwatch.lap('translation')
    return poses, J


def settle_last(poses: Array, target: LearnedMap, source: LearnedMap,
                sketch: bool) -> tuple[Array, Array]:
    """Take the last steps of Algorithm 2 from poses (B, 3), with all features or a sketch."""
    return translation.settle(poses, source.sketch if sketch else source.features,
                              target.features, target.nearest,
                              np.radians(SEARCH.last_angles), SEARCH.last_reaches)
