# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two maps in, their relative pose with a verdict out: the paper's pipeline in order."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from time import perf_counter
from weakref import WeakKeyDictionary

import numpy as np
from somfusion_ros.fusion import deformation, measures, orientation, refinement, translation
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion import voting
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.features import Map, Warp
from somfusion_ros.fusion.learned_map import CELL, learn
from somfusion_ros.fusion.map_trace import map_trace, MapTrace
from somfusion_ros.fusion.rasters import nearest
from somfusion_ros.geometry import Array, inverse, Pose, rotation
from somfusion_ros.grid import Grid

FEWEST = 8          # features below which a map cannot be matched
CANDIDATES = 40     # distinct poses of which the cells choose the finalists
PEAKS = 4           # peaks of the histograms' correlation that are followed
BENT_RIVALS = 1     # rivals that may bend too
VOTE_CELLS = 512    # most cells along an edge of the voting grid
FINAL = (np.radians([9.0, 6.0, 5.0, 4.0]), (0.4, 0.3, 0.2, 0.15))   # last steps of Algorithm 2
PUBLISHED_V = 0.9   # V from which the published method trusts its only hypothesis


_answers: WeakKeyDictionary[Grid, WeakKeyDictionary[Grid, dict[FusionConfig, 'Alignment']]] = (
    WeakKeyDictionary())


@dataclass(frozen=True)
class RunnerUp:
    """The best rival of an alignment that lies at a clearly different pose."""

    T_target_source: Pose
    probability: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """
    The verdict on one pair of maps.

    accepted, probability (0..1) of being right, reason (a sentence with numbers), the best pose
    found or None, its covariance (3, 3), V in percent (12), J per iteration (10), the share of
    the smaller map that overlaps, the best rival or None, and seconds per stage.
    """

    accepted: bool
    probability: float
    reason: str
    T_target_source: Pose | None = None
    covariance: Array = field(default_factory=lambda: np.full((3, 3), np.inf))
    verification_index: float = 0.0
    performance_index: tuple[float, ...] = ()
    overlap: float = 0.0
    runner_up: RunnerUp | None = None
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Trace:
    """An alignment, what was learned of both maps, the correlation (360,) of histograms, J."""

    alignment: Alignment
    target: MapTrace
    source: MapTrace
    correlation: Array
    performance_index: tuple[float, ...]


def align(target: Grid, source: Grid, config: FusionConfig | None = None,
          rng: np.random.Generator | None = None) -> Alignment:
    """
    Find the pose of the source map in the target map.

    Never raises on maps that cannot be matched: "no match" is an Alignment with a reason. No
    random number is drawn; `rng` is there for methods that need one. Both directions give the
    same answer: inside, the map with more wall is always the target. The answer is kept with the
    two Grid objects: asking again costs nothing.
    """
    config = config or FusionConfig()
    known = _answers.setdefault(target, WeakKeyDictionary()).setdefault(source, {})
    if config not in known:
        known[config] = _align_learned(target, source, config)
    return known[config]


def _align_learned(target: Grid, source: Grid, config: FusionConfig) -> Alignment:
    """Learn both maps, and match them in the order that does not depend on their roles."""
    clock = Clock()
    maps = learn(target, config), learn(source, config)
    clock.lap('learning')
    for name, one in zip(('target', 'source'), maps):
        if len(one.features) < FEWEST or len(one.free) == 0:
            return Alignment(False, 0.0, f'refused: the {name} map shows too little '
                             f'({len(one.features)} clusters with a norm, {len(one.free)} free '
                             'places)', seconds=clock.seconds)
    method = _align_as_published if config.method == 'paper' else _align
    if _rank(target, maps[0]) >= _rank(source, maps[1]):
        return method(*maps, config, clock)
    return _turned_round(method(*maps[::-1], config, clock))


def _align(target: Map, source: Map, config: FusionConfig, clock: 'Clock') -> Alignment:
    """Every stage in order, with many hypotheses at once."""
    poses, J = search(target, source, config, clock)
    verdict, poses, J, evidence, warp = verify(poses, J, target, source, config)
    clock.lap('verification')
    pose, covariance = refinement.refine(poses[verdict.best], target, source)
    covariance = refinement.widen(covariance, pose, source, warp)
    clock.lap('refinement')
    return _report(pose, covariance, verdict, evidence, J[:, verdict.best], poses, clock)


def search(target: Map, source: Map, config: FusionConfig,
           clock: 'Clock') -> tuple[Array, Array]:
    """Propose distinct poses (B, 3) of the source, with J of every step, (steps, B)."""
    correlation = orientation.correlate(target.histogram, source.histogram)
    turns = orientation.tune(orientation.peaks(correlation, PEAKS), target.spectrum,
                             source.spectrum)
    clock.lap('orientation')
    votes = voting.VoteGrid(target.features, source.features, config.vote_cell, VOTE_CELLS)
    poses = np.concatenate([votes.seeds(turn, config.seeds).reshape(-1, 3)
                            for turn in orientation.families(turns)])
    clock.lap('seeds')
    poses, _ = translation.settle(poses, source.sketch, target.features, target.nearest)
    score = measures.scores(poses, target, source, every=2)
    poses = measures.distinct(poses, score, source.pivot, CANDIDATES)
    matched, against = measures.fine(poses, target, source)
    rank = np.argsort(-matched ** 1.5 / (matched + against + 1.0), kind='stable')
    poses = poses[rank[:config.finalists]]
    poses, J = translation.settle(poses, source.features, target.features, target.nearest, *FINAL)
    clock.lap('translation')
    return poses, J


def verify(poses: Array, J: Array, target: Map, source: Map, config: FusionConfig
           ) -> tuple[verdicts.Verdict, Array, Array, measures.Evidence, Warp]:
    """Judge the best of hypotheses (B, 3); return all with their J, its evidence and its warp."""
    evidence = measures.measure(poses, target, source)
    first = _judge(poses, evidence, {}, source, config)
    if first.is_clear:
        bent = {first.best: _bent(poses[first.best], target, source)}
        verdict = _judge(poses, evidence, bent, source, config)
        return verdict, poses, J, *bent[verdict.best]
    beside = verdicts.slides(poses[first.best], evidence[first.best].axis)
    beside, more = translation.settle(beside, source.sketch, target.features, target.nearest,
                                      *FINAL)
    poses, J = np.concatenate([poses, beside]), np.hstack([J, more])
    evidence += measures.measure(beside, target, source)
    # Bending may turn the order round: the best two places are judged bent.
    best = max(range(len(poses)), key=lambda k: evidence[k].score)
    others = verdicts.rivals(poses, evidence, best, source.pivot)
    bent = {k: _bent(poses[k], target, source) for k in (best, *others[:BENT_RIVALS])}
    verdict = _judge(poses, evidence, bent, source, config)
    return verdict, poses, J, *bent[verdict.best]


def _judge(poses: Array, evidence: list[measures.Evidence],
           bent: dict[int, tuple[measures.Evidence, Warp]], source: Map,
           config: FusionConfig) -> verdicts.Verdict:
    """Judge the best of hypotheses (B, 3), of those that were bent if any was."""
    items = {k: item for k, (item, _) in bent.items()} or dict(enumerate(evidence))
    best = max(items, key=lambda k: items[k].score)
    others = verdicts.rivals(poses, evidence, best, source.pivot)
    return verdicts.judge(poses, evidence, best, items, others, config.estimation_confidence)


def _bent(pose: Array, target: Map, source: Map) -> tuple[measures.Evidence, Warp]:
    """Evidence of a hypothesis (3,) when the maps may bend, and how they bend."""
    warp = deformation.bend(pose, target, source)
    evidence, = measures.measure(pose[None], target, source, warp)
    return evidence, warp


def _align_as_published(target: Map, source: Map, config: FusionConfig,
                        clock: 'Clock') -> Alignment:
    """Follow the paper to the letter: one orientation, one start, and V decides."""
    correlation = orientation.correlate(target.histogram, source.histogram)
    theta = orientation.tune(orientation.peaks(correlation, 1), target.spectrum,
                             source.spectrum)[0]
    clock.lap('orientation')
    start = np.r_[target.pivot - rotation(theta) @ source.pivot, theta]
    pose, J = translation.mean_shift(start, source.features, target.features,
                                     nearest(target.features.centres, 2.0 * CELL, 1.0))
    clock.lap('translation')
    evidence, = measures.measure(pose[None], target, source)
    verdict = verdicts.judge_by_V(evidence, PUBLISHED_V)
    clock.lap('verification')
    return _report(pose, np.diag([0.01, 0.01, 1e-4]), verdict, evidence, J, pose[None], clock)


def trace(target: Grid, source: Grid, config: FusionConfig | None = None) -> Trace:
    """Return `align` together with its intermediate products, for figures."""
    config = config or FusionConfig()
    first, second = (map_trace(learn(grid, config)) for grid in (target, source))
    alignment = align(target, source, config)
    correlation = orientation.correlate(first.histogram, second.histogram)
    return Trace(alignment, first, second, correlation, alignment.performance_index)


class Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        """Start."""
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        """Note what passed since the last call under the name of a stage."""
        now = perf_counter()
        self.seconds[stage], self._last = now - self._last, now


def _report(pose: Array, covariance: Array, verdict: verdicts.Verdict,
            evidence: measures.Evidence, J: Iterable[float], poses: Array,
            clock: Clock) -> Alignment:
    """Put the answer together."""
    rival = None if verdict.rival is None else RunnerUp(
        Pose.from_array(poses[verdict.rival]), verdict.rival_probability)
    return Alignment(verdict.accepted, verdict.probability, verdict.reason, Pose.from_array(pose),
                     covariance, 100.0 * float(evidence.V), tuple(float(value) for value in J),
                     float(evidence.overlap), rival, clock.seconds)


def _rank(grid: Grid, one: Map) -> tuple[int, tuple[int, int], bytes]:
    """Order two maps by what they show, whichever is called the target."""
    return len(one.cells), grid.shape, one.cells[:100].tobytes()


def _turned_round(answer: Alignment) -> Alignment:
    """Return the same answer for target and source exchanged."""
    T = answer.T_target_source
    c, s = np.cos(T.theta), np.sin(T.theta)
    # d inverse(T) / dT: the covariance follows the pose into the other frame.
    back = inverse(T)
    J = np.array([[-c, -s, back[1]], [s, -c, -back[0]], [0.0, 0.0, -1.0]])
    rival = answer.runner_up
    if rival is not None:
        rival = replace(rival, T_target_source=Pose(*inverse(rival.T_target_source)))
    return replace(answer, T_target_source=Pose(*back), runner_up=rival,
                   covariance=J @ answer.covariance @ J.T)
