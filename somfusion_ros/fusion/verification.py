# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several poses in, the verdict on the best of them out (section III-C)."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion import deformation, measures
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.search import settle_last
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class VerificationSettings:
    """Numbers that the verification was tuned with."""

    bent_rivals: int = tuned(1, 'rivals', 'may bend too', 'benchmarks/fusion/calibration.py')


VERIFICATION = VerificationSettings()


def verify(poses: Array, J: Array, target: LearnedMap, source: LearnedMap, config: FusionConfig
           ) -> tuple[verdicts.Verdict, Array, Array, measures.Evidence, Warp]:
    """Judge the best of hypotheses (B, 3); return all with their J, its evidence and its warp."""
    evidence = measures.measure(poses, target, source)
    first = _judge(poses, evidence, {}, source, config)
    if first.is_clear:
        bent = {first.best: _bent(poses[first.best], target, source)}
        verdict = _judge(poses, evidence, bent, source, config)
        return verdict, poses, J, *bent[verdict.best]
    beside = verdicts.slides(poses[first.best], evidence[first.best].axis)
    beside, more = settle_last(beside, target, source, sketch=True)
    poses, J = np.concatenate([poses, beside]), np.hstack([J, more])
    evidence += measures.measure(beside, target, source)
    # Bending may turn the order round: the best two places are judged bent.
    best = max(range(len(poses)), key=lambda k: evidence[k].score)
    others = verdicts.rivals(poses, evidence, best, source.pivot)
    bent = {k: _bent(poses[k], target, source) for k in (best, *others[:VERIFICATION.bent_rivals])}
    verdict = _judge(poses, evidence, bent, source, config)
    return verdict, poses, J, *bent[verdict.best]


def _judge(poses: Array, evidence: list[measures.Evidence],
           bent: dict[int, tuple[measures.Evidence, Warp]], source: LearnedMap,
           config: FusionConfig) -> verdicts.Verdict:
    """Judge the best of hypotheses (B, 3), of those that were bent if any was."""
    items = {k: item for k, (item, _) in bent.items()} or dict(enumerate(evidence))
    best = max(items, key=lambda k: items[k].score)
    others = verdicts.rivals(poses, evidence, best, source.pivot)
    return verdicts.judge(poses, evidence, best, items, others, config.estimation_confidence)


def _bent(pose: Array, target: LearnedMap, source: LearnedMap) -> tuple[measures.Evidence, Warp]:
    """Evidence of a hypothesis (3,) when the maps may bend, and how they bend."""
    warp = deformation.bend(pose, target, source)
    evidence, = measures.measure(pose[None], target, source, warp)
    return evidence, warp
