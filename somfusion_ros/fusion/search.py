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
    inexact: float = tuned(
        3.0, 'root m', 'or score of the wall cells: most of the true pairs that were missed have '
        'a better one than what was found', 'doc/fusion.md')
    wide_peaks: int = tuned(
        8, 'peaks', 'are followed then: in a large hall full of furniture the walls are not the '
        'most frequent direction', 'benchmarks/fusion/calibration.py: years')
    wide_seeds: int = tuned(
        336, 'seeds', 'or at least as many as at first are tried then, over all turns',
        'benchmarks/fusion/calibration.py: bent')
    wide_finalists: int = tuned(
        6, 'poses', 'of these are judged beside those of the first search: where maps are bent, '
        'the right one may rank behind many that fit by chance', 'doc/fusion.md')
    candidates: int = tuned(
        40, 'poses', 'distinct, of which the wall cells choose the finalists',
        'benchmarks/fusion/stages.py')
    exact: int = tuned(
        2, 'poses', 'of the finalists are those that fit best, the others match most wall: where '
        'the overlap is a strip', 'doc/fusion.md')
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
    found = _settled([votes.seeds(turn, config.seeds) for turn in turns], target, source)
    best = _candidates(*found, target, source)
    poses = best.first(config.finalists)
    if found[1].max(initial=0.0) < SEARCH.weak or best.exact_score < SEARCH.inexact:
        wide = _turns(correlation, target, source, SEARCH.wide_peaks)     # begins with `turns`
        count = max(config.seeds, SEARCH.wide_seeds // (voting.QUARTERS * len(wide)))
        more = _settled([votes.seeds(turn, count)[:, config.seeds if k < len(turns) else 0:]
                         for k, turn in enumerate(wide)], target, source)
        others = _candidates(*more, target, source).first(SEARCH.wide_finalists)
        poses = np.concatenate([poses, others])
    stopwatch.lap('seeds')
    poses, J = settle_last(poses, target, source, sketch=False)
    stopwatch.lap('translation')
    return poses, J


@dataclass(frozen=True, eq=False)
class _Candidates:
    """
    Distinct poses (B, 3), and what is known of them.

    matched, against (B,): wall cells that coincide, and that speak against [m]; common (B,): area
    that both maps saw free [m2].
    """

    poses: Array
    matched: Array
    against: Array
    common: Array

    @property
    def exact(self) -> Array:
        """Score (B,) of the poses as the verdict ranks them: a small overlap that fits may win."""
        ratio = self.matched / (self.matched + self.against + 1.0)
        return np.asarray(ratio ** 2 * np.sqrt(self.matched)
                          * scoring.seen_in_front(self.common, self.matched))

    @property
    def exact_score(self) -> float:
        """Best of these scores; without bound where the source has no cells to be looked up."""
        return float(self.exact.max(initial=0.0)) if self.matched.any() else np.inf

    def first(self, count: int) -> Array:
        """Return so many poses, first those of much wall, last the best of those that fit."""
        large = np.argsort(-self.matched ** 1.5 / (self.matched + self.against + 1.0),
                           kind='stable')
        exact = np.argsort(-self.exact, kind='stable')
        chosen = dict.fromkeys([*large[:count - SEARCH.exact], *exact])
        return self.poses[list(chosen)[:count]]


def _candidates(poses: Array, score: Array, target: LearnedMap,
                source: LearnedMap) -> _Candidates:
    """Look up the wall cells of the best distinct ones of poses (B, 3) with scores (B,)."""
    poses = scoring.distinct(poses, score, source.pivot, SEARCH.candidates)
    matched, against = scoring.fine(poses, target, source)
    return _Candidates(poses, matched, against, scoring.common(poses, target, source))


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
