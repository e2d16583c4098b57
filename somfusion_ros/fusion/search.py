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
    wide_turns: int = tuned(
        2, 'turns', 'of these peaks are followed once more then,',
        'benchmarks/fusion/calibration.py: worn')
    wide_cell: float = tuned(
        0.5, 'times', 'as large are the cells in which pairs of clusters vote then',
        'benchmarks/fusion/calibration.py: worn, office')
    wide_seeds: int = tuned(
        60, 'seeds', 'for each quarter turn are tried then, over these turns',
        'benchmarks/fusion/calibration.py: worn')
    wide_finalists: int = tuned(
        10, 'poses', 'of these are judged beside those of the first search: where maps are bent, '
        'the right one may rank behind many that fit by chance', 'doc/fusion.md')
    swept_turns: int = tuned(
        20, 'turns', 'of a quarter turn are tried then, whatever the histograms say',
        'benchmarks/fusion/calibration.py: years, bent')
    swept_cell: float = tuned(
        2.0, 'times', 'as large are the cells in which pairs of clusters vote for a shift at them',
        'benchmarks/fusion/calibration.py: years, bent')
    swept_seeds: int = tuned(
        60, 'seeds', 'of all those turns are tried: those whose votes stand out most',
        'benchmarks/fusion/calibration.py: years, bent')
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposals:
    """
    Distinct poses (B, 3) of the source, with J of every step, (steps, B).

    turns (N,): orientations of the histograms, modulo a quarter turn [rad], best first; wide:
    whether poses were looked for beyond them.
    """

    poses: Array
    J: Array
    turns: Array
    wide: bool = False


def search(target: LearnedMap, source: LearnedMap, config: FusionConfig,
           stopwatch: Stopwatch) -> Proposals:
    """Propose poses of the source; where none convinces, wider."""
    turns = orientation.families(orientation.tune(
        orientation.peaks(orientation.correlate(target.histogram, source.histogram),
                          SEARCH.peaks), target.spectrum, source.spectrum))
    stopwatch.lap('orientation')
    votes = voting.VoteGrid(target.features, source.features, config.vote_cell, SEARCH.vote_cells)
    settled, score = _settled([votes.seeds(turn, config.seeds) for turn in turns], target, source)
    best = _candidates(settled, score, target, source)
    stopwatch.lap('seeds')
    poses, J = settle_last(best.first(config.finalists), target, source, sketch=False)
    stopwatch.lap('translation')
    found = Proposals(poses=poses, J=J, turns=turns)
    if score.max(initial=0.0) >= SEARCH.weak and best.exact_score >= SEARCH.inexact:
        return found
    found = widened(found, target, source, config)
    stopwatch.lap('wider search')
    return found


def widened(found: Proposals, target: LearnedMap, source: LearnedMap,
            config: FusionConfig) -> Proposals:
    """
    Propose more poses, beside those that do not convince.

    At the turns of the histograms by finer votes, which worn walls and equal rooms need; and at
    any turn, as furniture and bends hide the right one from histograms.
    """
    cell, few = config.vote_cell, found.turns[:SEARCH.wide_turns]
    fine, coarse = (voting.VoteGrid(target.features, source.features, cell * times,
                                    SEARCH.vote_cells)
                    for times in (SEARCH.wide_cell, SEARCH.swept_cell))
    swept = np.arange(SEARCH.swept_turns) * (np.pi / 2.0 / SEARCH.swept_turns)
    seeds = [fine.seeds(turn, SEARCH.wide_seeds // len(few)) for turn in few]
    seeds += [coarse.outstanding(swept, SEARCH.swept_seeds)]
    best = _candidates(*_settled(seeds, target, source), target, source)
    poses, J = settle_last(best.first(SEARCH.wide_finalists), target, source, sketch=False)
    return Proposals(poses=np.concatenate([found.poses, poses]), J=np.hstack([found.J, J]),
                     turns=found.turns, wide=True)


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


def _settled(seeds: list[Array], target: LearnedMap, source: LearnedMap) -> tuple[Array, Array]:
    """Settle seeds (..., 3) of every turn with a sketch: poses (B, 3), and their scores (B,)."""
    start = np.concatenate([some.reshape(-1, 3) for some in seeds])
    poses, _ = translation.settle(start, source.sketch, target.features, target.nearest)
    return poses, scoring.scores(poses, target, source, every=2)


def settle_last(poses: Array, target: LearnedMap, source: LearnedMap,
                sketch: bool) -> tuple[Array, Array]:
    """Take the last steps of Algorithm 2 from poses (B, 3), with all features or a sketch."""
    return translation.settle(poses, source.sketch if sketch else source.features,
                              target.features, target.nearest,
                              np.radians(SEARCH.last_angles), SEARCH.last_reaches)
