# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several poses in, the verdict on the best of them out (section III-C)."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.fusion import deformation, measures, translation
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.passages import passable
from somfusion_ros.fusion.rivals import rivals, slides
from somfusion_ros.fusion.search import settle_last
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class VerificationSettings:
    """Numbers that the verification was tuned with."""

    bent_wide: int = tuned(
        3, 'poses', 'may bend, those that match most wall within the tolerance of a bend: the '
        'right one is among them in all of pairs_mesh', 'doc/fusion.md: pairs_mesh')
    bent_rigid: int = tuned(
        2, 'poses', 'may bend, those that fit best to a cell: doors tell corridors apart',
        'benchmarks/fusion/calibration.py: corridor')
    loose_angles: tuple[float, ...] = tuned(
        (25.0, 20.0), 'deg', 'first thresholds of Algorithm 2, from which a bend starts',
        'by design')
    loose_reaches: tuple[float, ...] = tuned(
        (1.2, 0.9), 'm', 'furthest match at each of them: the start lies in the middle of a bend, '
        'not at the end that fits best; without, poses of pairs_mesh are worse by a half',
        'doc/fusion.md: pairs_mesh')
    bent_slides: int = tuned(
        2, 'poses', 'beside the best, along the direction that is fixed worst, may bend too',
        'benchmarks/fusion/calibration.py')
    hopeless: float = tuned(
        0.05, 'probability', 'below which, without a rival, none is looked for, which saves time '
        'where places differ; with rivals, the search is widened',
        'benchmarks/fusion/calibration.py: office')


VERIFICATION = VerificationSettings()


@dataclass(frozen=True, eq=False, kw_only=True)
class Verified:
    """The verdict on several poses (B, 3) with J of each (steps, B), and how the best bends."""

    verdict: verdicts.Verdict
    poses: Array
    J: Array
    evidence: measures.Evidence
    warp: Warp


class _Hypotheses:
    """Poses with the evidence for each, of which some were allowed to bend."""

    def __init__(self, poses: Array, J: Array, target: LearnedMap, source: LearnedMap,
                 config: FusionConfig) -> None:
        self.target, self.source, self.config = target, source, config
        self.poses, self.J = np.empty((0, 3)), np.empty((len(J), 0))
        self.evidence: list[measures.Evidence] = []
        self.warps: dict[int, Warp] = {}
        self.starts: dict[int, Array] = {}     # that the warps belong to
        self.add(poses, J)

    def add(self, poses: Array, J: Array) -> None:
        """Take more poses (B, 3) in, with J of each (steps, B)."""
        self.poses, self.J = np.concatenate([self.poses, poses]), np.hstack([self.J, J])
        self.evidence += measures.measure(poses, self.target, self.source)

    def bend(self, numbers: Iterable[int]) -> None:
        """Let the maps bend in some of the poses; each becomes the rigid part of its motion."""
        chosen = [int(number) for number in numbers]
        if not chosen:
            return
        starts, _ = translation.settle(
            self.poses[chosen], self.source.sketch, self.target.features, self.target.nearest,
            np.radians(VERIFICATION.loose_angles), VERIFICATION.loose_reaches)
        for number, start in zip(chosen, starts, strict=True):
            found = deformation.bend(start, self.target, self.source)
            item, = measures.measure(start[None], self.target, self.source, found.warp)
            item = replace(item, strain=found.strain, scale=found.scale)
            self.evidence[number], self.poses[number] = item, found.pose
            self.warps[number], self.starts[number] = found.warp, start

    def best(self) -> int:
        """Return the best pose, of those that were bent if any was."""
        return max(self.warps or range(len(self.poses)), key=lambda k: self.evidence[k].score)

    def promising(self) -> Index:
        """List the poses that may be best once the maps bend, and those that are while rigid."""
        wide = [item.matched ** 1.5 / (item.matched + item.against + 1.0)
                for item in self.evidence]
        rigid = [item.score for item in self.evidence]
        ranks = [np.argsort(np.negative(rank), kind='stable') for rank in (wide, rigid)]
        return np.unique(np.concatenate([ranks[0][:VERIFICATION.bent_wide],
                                         ranks[1][:VERIFICATION.bent_rigid]]))

    def judge(self) -> verdicts.Verdict:
        """Weigh the best pose against all others."""
        best = self.best()
        others = rivals(self.poses, self.evidence, best, self.source.pivot)
        return verdicts.judge(self.poses, self.evidence, best, others,
                              self.config.estimation_confidence)

    def look_at_passages(self) -> None:
        """Find out how far the maps hang together in the best pose."""
        best = self.best()
        lay = measures.Overlay(self.starts[best][None], self.warps[best])
        less, more = sorted([passable(self.source, self.target, lay.forth),
                             passable(self.target, self.source, lay.back)])
        self.evidence[best] = replace(self.evidence[best], passable=less, passable_other=more)

    def verified(self) -> Verified:
        """Judge, and put the answer together."""
        verdict = self.judge()
        return Verified(verdict=verdict, poses=self.poses, J=self.J,
                        evidence=self.evidence[verdict.best], warp=self.warps[verdict.best])


def verify(poses: Array, J: Array, target: LearnedMap, source: LearnedMap,
           config: FusionConfig) -> Verified:
    """
    Judge the best of hypotheses (B, 3), proposed with J (steps, B).

    Where the best is not clear while the maps are rigid, those that match most wall within the
    tolerance of a bend are bent before they are compared: an overlap that is large and bent would
    else lose against a small one that fits by chance. Where even then the best could not be
    accepted, no more rivals are looked for.
    """
    found = _Hypotheses(poses, J, target, source, config)
    first = found.judge()
    if first.is_clear:
        found.bend([first.best])
        found.look_at_passages()
        return found.verified()
    found.bend(found.promising())
    best = found.best()
    if verdicts.probability(found.evidence[best], verdicts.CLEAR) < VERIFICATION.hopeless:
        return found.verified()
    beside = slides(found.poses[best], found.evidence[best].axis)
    found.add(*settle_last(beside, target, source, sketch=True))
    others = rivals(found.poses, found.evidence, best, source.pivot)
    found.bend(others[others >= len(poses)][:VERIFICATION.bent_slides])
    found.look_at_passages()
    return found.verified()
