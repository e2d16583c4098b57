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
        168, 'seeds', 'or at least as many as at first are tried then, over all turns',
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
    turns = _turns(correlation, target, source, SEARCH.peaks)
    stopwatch.lap('orientation')
    votes = voting.VoteGrid(target.features, source.features, config.vote_cell, SEARCH.vote_cells)
    poses, score = _settled([votes.seeds(turn, config.seeds) for turn in turns], target, source)
    if score.max(initial=0.0) < SEARCH.weak:
        wide = _turns(correlation, target, source, SEARCH.wide_peaks)     # begins with `turns`
        count = max(config.seeds, SEARCH.wide_seeds // (voting.QUARTERS * len(wide)))
        more = _settled([votes.seeds(turn, count)[:, config.seeds if k < len(turns) else 0:]
                         for k, turn in enumerate(wide)], target, source)
        poses, score = (np.concatenate(both) for both in zip((poses, score), more, strict=True))
    stopwatch.lap('seeds')
    poses = scoring.distinct(poses, score, source.pivot, SEARCH.candidates)
    matched, against = scoring.fine(poses, target, source)
    rank = np.argsort(-matched ** 1.5 / (matched + against + 1.0), kind='stable')
    poses = poses[rank[:config.finalists]]
    poses, J = settle_last(poses, target, source, sketch=False)
    stopwatch.lap('translation')
    return poses, J


def _turns(correlation: Array, target: LearnedMap, source: LearnedMap, peaks: int) -> Array:
    """List the orientations (N,) modulo a quarter turn [rad], best first."""
    return orientation.families(orientation.tune(
        orientation.peaks(correlation, peaks), target.spectrum, source.spectrum))


def _settled(seeds: list[Array], target: LearnedMap, source: LearnedMap) -> tuple[Array, Array]:
    """Settle seeds (4, n, 3) of every turn with a sketch: poses (B, 3), and their scores (B,)."""
    start = np.concatenate([some.reshape(-1, 3) for some in seeds])
    poses, _ = translation.settle(start, source.sketch, target.features, target.nearest)
    return poses, scoring.scores(poses, target, source, every=2)


def settle_last(poses: Array, target: LearnedMap, source: LearnedMap,
                sketch: bool) -> tuple[Array, Array]:
    """Take the last steps of Algorithm 2 from poses (B, 3), with all features or a sketch."""
    return translation.settle(poses, source.sketch if sketch else source.features,
                              target.features, target.nearest,
                              np.radians(SEARCH.last_angles), SEARCH.last_reaches)
