# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two maps in, their relative pose with a verdict out: the paper's pipeline in order."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from somfusion_ros.fusion import measures, orientation, rasters, refinement, translation
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.answer import Alignment as Alignment
from somfusion_ros.fusion.answer import named, turned_round
from somfusion_ros.fusion.answer import RunnerUp as RunnerUp
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn, LEARNING
from somfusion_ros.fusion.lookout import lookout
from somfusion_ros.fusion.map_trace import map_trace, MapTrace
from somfusion_ros.fusion.mirror import mirror
from somfusion_ros.fusion.search import search, widened
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.fusion.verification import VERIFICATION, Verified, verify
from somfusion_ros.geometry import Array, inverse, Pose, rotation
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class AlignmentSettings:
    """Numbers that the merge of two maps was tuned with."""

    fewest_features: int = tuned(
        8, 'clusters', 'a map of fewer that have a normal cannot be matched', 'by design')
    exact: float = tuned(
        0.75, 'share', 'of wall that coincides to a cell from which a clear hypothesis is not '
        'held against its mirror image; at most 0.68 in mirrored buildings', 'doc/verdict.md')
    bent_from: float = tuned(
        0.1, 'm', 'strain from which a pose is that of all matched walls, not of the part that '
        'fits best', 'doc/fusion.md: pairs_mesh')
    published_v: float = tuned(
        0.9, 'share', 'V (12) from which the published method trusts its only hypothesis',
        'benchmarks/fusion/stages.py')


ALIGNMENT = AlignmentSettings()


@dataclass(frozen=True, eq=False, kw_only=True)
class Trace:
    """An alignment, what was learned of both maps, the correlation (360,) of histograms, J."""

    alignment: Alignment
    target: MapTrace
    source: MapTrace
    correlation: Array
    performance_index: tuple[float, ...]


def align(target: Grid, source: Grid, config: FusionConfig | None = None,
          rng: np.random.Generator | None = None, cache: FusionCache | None = None) -> Alignment:
    """
    Find the pose of the source map in the target map.

    Both directions give the same answer: inside, the map with more wall is always the target.

    Parameters
    ----------
    target, source : Grid
        Maps of any size, resolution and origin.
    config : FusionConfig, optional
        Parameters of the merge.
    rng : numpy.random.Generator, optional
        Not drawn from: the merge is deterministic.
    cache : FusionCache, optional
        Keeps what was learned of the two Grid objects, and the answer: the same question costs
        nothing the second time.

    Returns
    -------
    Alignment
        "No match" is an Alignment with a reason, not an exception.

    References
    ----------
    S. Saeedi, L. Paull, M. Trentini, H. Li: Neural network-based multiple robot simultaneous
    localization and mapping, IROS 2011.

    Examples
    --------
    >>> import numpy as np
    >>> from somfusion_ros.grid import Grid
    >>> cells = np.full((60, 80), -1)
    >>> cells[10:50, 10:70] = 0
    >>> cells[[10, 49], 10:70] = cells[10:50, [10, 69]] = 100    # a room with four walls,
    >>> room = Grid.from_occupancy(cells.copy(), 0.1)
    >>> cells[10:30, 40] = 100                                    # and the same, divided
    >>> found = align(room, Grid.from_occupancy(cells, 0.1))
    >>> found.accepted
    False
    """
    config, cache = config or FusionConfig(), cache or FusionCache()
    known = cache.answers.setdefault(target, WeakKeyDictionary()).setdefault(source, {})
    if config not in known:
        known[config] = _align_grids(target, source, config, cache)
    return known[config]


def _align_grids(target: Grid, source: Grid, config: FusionConfig,
                 cache: FusionCache) -> Alignment:
    """Learn both maps, and match them in the order that does not depend on their roles."""
    stopwatch = Stopwatch()
    maps = learn(target, config, cache), learn(source, config, cache)
    stopwatch.lap('learning')
    for name, one in zip(('target', 'source'), maps, strict=True):
        if len(one.features) < ALIGNMENT.fewest_features or len(one.free) == 0:
            return Alignment(accepted=False, probability=0.0, seconds=stopwatch.seconds,
                             reason=f'refused: the {name} map shows too little '
                             f'({len(one.features)} clusters with a normal, {len(one.free)} free '
                             'places)')
    method = _align_as_published if config.method == 'paper' else _align
    if _rank(target, maps[0]) >= _rank(source, maps[1]):
        return named(method(*maps, config, stopwatch))
    return named(turned_round(method(*maps[::-1], config, stopwatch)))


def _align(target: LearnedMap, source: LearnedMap, config: FusionConfig,
           stopwatch: Stopwatch) -> Alignment:
    """Take every stage in order, with many hypotheses at once."""
    found = find(target, source, config, stopwatch)
    verdict = found.verdict
    if verdict.accepted and may_be_image(found):
        image = find(target, mirror(source), config, Stopwatch())
        verdict = verdicts.beside_image(verdict, found.evidence, image.verdict, image.evidence)
        stopwatch.lap('mirror image')
    best = verdict.best
    pose, covariance = refinement.refine(found.poses[best], target, source)
    if found.evidence.strain > ALIGNMENT.bent_from:
        pose = found.poses[best]
    covariance = refinement.widen(covariance, pose, source, found.warp)
    stopwatch.lap('refinement')
    answer = _report(pose, covariance, verdict, found.evidence, found.J[:, best], found.poses,
                     stopwatch)
    return _with_lookouts(answer, target, source) if verdict.ambiguous else answer


def find(target: LearnedMap, source: LearnedMap, config: FusionConfig,
         stopwatch: Stopwatch) -> Verified:
    """Search and judge; and once more, wider, where all that was found is hopeless."""
    proposed = search(target, source, config, stopwatch)
    found = verify(proposed.poses, proposed.J, target, source, config)
    stopwatch.lap('verification')
    if not proposed.wide and found.verdict.probability < VERIFICATION.hopeless:
        proposed = widened(proposed, target, source, config)
        found = verify(proposed.poses, proposed.J, target, source, config)
        stopwatch.lap('wider search')
    return found


def _with_lookouts(answer: Alignment, target: LearnedMap, source: LearnedMap) -> Alignment:
    """Add the places that tell the two candidates of an ambiguous answer apart."""
    if answer.T_target_source is None or answer.runner_up is None:
        return answer
    first, second = (np.array(pose) for pose in (
        answer.T_target_source, answer.runner_up.T_target_source))
    return replace(answer, lookout_target=lookout(target, source, first, second),
                   lookout_source=lookout(source, target, inverse(first), inverse(second)))


def may_be_image(found: Verified) -> bool:
    """Tell whether the mirror image is worth a look: not where all fits to a cell."""
    return not found.verdict.is_clear or found.evidence.fine_ratio < ALIGNMENT.exact


def _align_as_published(target: LearnedMap, source: LearnedMap, config: FusionConfig,
                        stopwatch: Stopwatch) -> Alignment:
    """Follow the paper to the letter: one orientation, one start, and V decides."""
    correlation = orientation.correlate(target.histogram, source.histogram)
    theta = orientation.tune(orientation.peaks(correlation, 1), target.spectrum,
                             source.spectrum)[0]
    stopwatch.lap('orientation')
    start = np.r_[target.pivot - rotation(theta) @ source.pivot, theta]
    nearest = rasters.nearest(target.features.centres, 2.0 * LEARNING.cell, 1.0)
    pose, J = translation.mean_shift(start, source.features, target.features, nearest)
    stopwatch.lap('translation')
    evidence, = measures.measure(pose[None], target, source)
    verdict = verdicts.judge_by_V(evidence, ALIGNMENT.published_v)
    stopwatch.lap('verification')
    return _report(pose, np.diag([0.01, 0.01, 1e-4]), verdict, evidence, J, pose[None], stopwatch)


def trace(target: Grid, source: Grid, config: FusionConfig | None = None,
          cache: FusionCache | None = None) -> Trace:
    """Return `align` together with its intermediate products, for figures."""
    config, cache = config or FusionConfig(), cache or FusionCache()
    first, second = (map_trace(learn(grid, config, cache)) for grid in (target, source))
    alignment = align(target, source, config, cache=cache)
    return Trace(alignment=alignment, target=first, source=second,
                 correlation=orientation.correlate(first.histogram, second.histogram),
                 performance_index=alignment.performance_index)


def _report(pose: Array, covariance: Array, verdict: verdicts.Verdict,
            evidence: measures.Evidence, J: Iterable[float], poses: Array,
            stopwatch: Stopwatch) -> Alignment:
    """Put the answer together."""
    rival = None if verdict.rival is None else RunnerUp(
        Pose.from_array(poses[verdict.rival]), verdict.rival_probability)
    return Alignment(
        accepted=verdict.accepted, probability=verdict.probability, reason=verdict.reason,
        T_target_source=Pose.from_array(pose), covariance=covariance,
        verification_index=100.0 * float(evidence.V),
        performance_index=tuple(float(value) for value in J), overlap=float(evidence.overlap),
        runner_up=rival, seconds=stopwatch.seconds)


def _rank(grid: Grid, one: LearnedMap) -> tuple[int, tuple[int, int], bytes]:
    """Order two maps by what they show, whichever is called the target."""
    return len(one.cells), grid.shape, one.cells[:100].tobytes()
