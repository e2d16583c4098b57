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
    weak: float = tuned(
        4.0, 'root m', 'score of the best pose below which the search is repeated, wider: true '
        'pairs of the shared ones reach 4.9', 'benchmarks/fusion/calibration.py: worn, years')
    wide_peaks: int = tuned(
        8, 'peaks', 'are followed then: in a large hall full of furniture the walls are not the '
        'most frequent direction', 'benchmarks/fusion/calibration.py: years')
    wide_seeds: int = tuned(
        168, 'seeds', 'are tried then, over all turns: bounds the time',
        'benchmarks/fusion/calibration.py: bent')
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
    votes = voting.VoteGrid(target.features, source.features, config.vote_cell, SEARCH.vote_cells)
    stopwatch.lap('orientation')
    poses, score = _propose(correlation, votes, target, source, SEARCH.peaks, config.seeds)
    if score.max(initial=0.0) < SEARCH.weak:
        poses, score = _propose(correlation, votes, target, source, SEARCH.wide_peaks, None)
    stopwatch.lap('seeds')
    poses = scoring.distinct(poses, score, source.pivot, SEARCH.candidates)
    matched, against = scoring.fine(poses, target, source)
    rank = np.argsort(-matched ** 1.5 / (matched + against + 1.0), kind='stable')
    poses = poses[rank[:config.finalists]]
    poses, J = settle_last(poses, target, source, sketch=False)
    stopwatch.lap('translation')
    return poses, J


def _propose(correlation: Array, votes: voting.VoteGrid, target: LearnedMap, source: LearnedMap,
             peaks: int, seeds: int | None) -> tuple[Array, Array]:
    """Settle as many seeds of every turn, or all that are allowed: poses (B, 3), scores (B,)."""
    turns = orientation.tune(orientation.peaks(correlation, peaks), target.spectrum,
                             source.spectrum)
    families = orientation.families(turns)
    if seeds is None:
        seeds = max(1, SEARCH.wide_seeds // (voting.QUARTERS * len(families)))
    poses = np.concatenate([votes.seeds(turn, seeds).reshape(-1, 3) for turn in families])
    poses, _ = translation.settle(poses, source.sketch, target.features, target.nearest)
    return poses, scoring.scores(poses, target, source, every=2)


def settle_last(poses: Array, target: LearnedMap, source: LearnedMap,
                sketch: bool) -> tuple[Array, Array]:
    """Take the last steps of Algorithm 2 from poses (B, 3), with all features or a sketch."""
    return translation.settle(poses, source.sketch if sketch else source.features,
                              target.features, target.nearest,
                              np.radians(SEARCH.last_angles), SEARCH.last_reaches)
