# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Is a hypothesis right? (section III-C, equations (10)-(12), and a calibrated verdict).

V of (12) cannot tell right from wrong where the overlap is small, so several measures decide
together: how much wall is matched, how much wall should be seen and is not, how well the
direction with the least evidence is fixed (two parallel walls fit into every corridor of that
width), how much of the smaller map lies on the other one, and the best rival.
"""

from dataclasses import dataclass

import numpy as np

from somfusion_ros.fusion.features import Clusters, Map, match, place, Raster
from somfusion_ros.geometry import Array, inverse, rotation, wrap

TOLERANCE = 0.2        # a wall within this distance of another is the same [m]
ANGLE = np.radians(25.0)


@dataclass(frozen=True)
class Evidence:
    """
    Measures of one hypothesis.

    matched: wall that coincides, mean of both maps [m]; ratio: matched / (matched + wall that
    the other map saw as free); overlap: share of the smaller map's free area that the other map
    knows; weak, weak_ratio: the same as matched and ratio for the direction with the least
    evidence; V of (12) [0..1].
    """

    matched: float
    ratio: float
    overlap: float
    weak: float
    weak_ratio: float
    V: float

    @property
    def score(self) -> float:
        """Matched ratio times the root of the matched length."""
        return self.ratio * np.sqrt(self.matched)


def scores(poses: Array, target: Map, source: Map, tolerance: float = TOLERANCE,
           every: int = 1) -> Array:
    """Score (B,) of hypotheses (B, 3) as `Evidence.score`, from every n-th cluster of both."""
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        total += _tally(way, seen.clusters.take(np.s_[::every]), by.clearance, tolerance)
    matched, against = total * every / 2.0
    return matched / (matched + against + 1.0) * np.sqrt(matched)


def _tally(poses: Array, clusters: Clusters, clearance: Raster, tolerance: float) -> Array:
    """Length (2, B) [m] of wall that lies on a wall, and that lies on free space."""
    away = clearance.at(place(poses, clusters.centres))
    return np.stack([(np.abs(away) <= tolerance) @ clusters.weights,
                     (away > tolerance) @ clusters.weights])


def distinct(poses: Array, score: Array, pivot: Array, count: int) -> Array:
    """Best `count` of hypotheses (B, 3) that differ by 0.5 m at pivot (2,) or 6 degrees."""
    spot, kept = place(poses, pivot[None])[:, :, 0].T, []
    for i in np.argsort(-score, kind='stable'):
        near = np.hypot(*(spot[kept] - spot[i]).T) < 0.5
        if not (near & (np.abs(wrap(poses[kept, 2] - poses[i, 2])) < 0.1)).any():
            kept.append(i)
        if len(kept) == count:
            break
    return poses[kept]


def measure(pose: Array, target: Map, source: Map, tolerance: float = TOLERANCE) -> Evidence:
    """Take all measures of one hypothesis (3,)."""
    pose = np.asarray(pose, dtype=float)[None]
    matched = against = 0.0
    info, contra = np.zeros((2, 2)), np.zeros((2, 2))
    shares, votes = [], np.zeros(2)
    for way, seen, by in ((pose, source, target), (inverse(pose), target, source)):
        on, off = _tally(way, seen.clusters, by.clearance, tolerance)[:, 0]
        matched, against = matched + on / 2.0, against + off / 2.0
        H = _information(way, seen, by, tolerance)
        R = rotation(pose[0, 2]) if seen is source else np.eye(2)
        info, contra = info + R @ H[0] @ R.T / 2.0, contra + R @ H[1] @ R.T / 2.0
        share, vote = _free_agreement(way, seen, by)
        shares.append(share)
        votes += vote
    weak, axes = np.linalg.eigh(info)
    against_weak = float(axes[:, 0] @ contra @ axes[:, 0])
    free = votes / max(votes.sum(), 1.0)
    return Evidence(matched, matched / (matched + against + 1.0), max(shares), float(weak[0]),
                    float(weak[0]) / (float(weak[0]) + against_weak + 0.5), float(free[0]))


def _information(pose: Array, seen: Map, by: Map, tolerance: float) -> Array:
    """Sum (2, 2, 2) of w n n' over matched clusters, and over those on free space [m]."""
    clusters = seen.features
    found = match(pose, clusters, by.features, by.nearest, ANGLE, 0.8)
    on = (found.agrees & (np.abs(found.off) <= tolerance))[0]
    off = by.clearance.at(found.at)[0] > tolerance
    weight = clusters.weights * clusters.straight
    return np.stack([(clusters.norms * (weight * which)[:, None]).T @ clusters.norms
                     for which in (on, off)])


def _free_agreement(pose: Array, seen: Map, by: Map) -> tuple[float, Array]:
    """Share of a map's free places that the other knows; numbers (2,) that agree, disagree."""
    away = by.clearance.at(place(pose, seen.free))[0]
    wall = np.abs(away) < 0.6 * by.clearance.resolution
    free = away > 0
    return float((wall | free).mean()), np.array([free.sum() - (wall & free).sum(), wall.sum()],
                                                 dtype=float)


@dataclass(frozen=True)
class Verdict:
    """Which hypothesis is best, its probability, whether it is accepted, and why."""

    best: int
    rival: int | None
    probabilities: Array
    accepted: bool
    reason: str


def judge(poses: Array, evidence: list[Evidence], pivot: Array, confidence: float) -> Verdict:
    """
    Weigh hypotheses (B, 3) by their evidence.

    pivot (2,) is the place of the source at which two poses are compared; rivals lie more than
    0.7 m or 8 degrees away from the best.
    """
    score = np.array([item.score for item in evidence])
    best = int(score.argmax())
    spot = place(poses, pivot[None])[:, :, 0].T
    apart = np.hypot(*(spot - spot[best]).T) > 0.7
    apart |= np.abs(wrap(poses[:, 2] - poses[best, 2])) > np.radians(8.0)
    rivals = np.flatnonzero(apart)
    rival = int(rivals[score[rivals].argmax()]) if len(rivals) else None
    chance = np.array([probability(item) for item in evidence])
    if rival is not None:
        margin = score[best] / max(score[rival], 1e-6)
        chance[best] *= 1.0 / (1.0 + np.exp(-20.0 * (margin - 1.15)))
    accepted = bool(chance[best] >= confidence)
    return Verdict(best, rival, chance, accepted,
                   _reason(accepted, evidence[best], poses, best, rival, score))


def probability(item: Evidence) -> float:
    """Chance that a hypothesis is right, from its own evidence alone."""
    z = (8.0 * (item.weak_ratio - 0.72) / 0.1 * 0.3 + 6.0 * (item.ratio - 0.8)
         + 1.5 * np.log((item.weak + 0.1) / 4.0) + 1.0 * np.log((item.matched + 0.1) / 15.0)
         + 0.5 * np.log((item.overlap + 0.01) / 0.1) + 1.0)
    return float(1.0 / (1.0 + np.exp(-np.clip(z, -30.0, 30.0))))


def _reason(accepted: bool, item: Evidence, poses: Array, best: int, rival: int | None,
            score: Array) -> str:
    """Say in one sentence, with numbers, what decided."""
    text = (f'{"accepted" if accepted else "refused"}: walls agree {100 * item.ratio:.0f} % over '
            f'{item.matched:.0f} m, {100 * item.weak_ratio:.0f} % over {item.weak:.1f} m in the '
            f'weakest direction, overlap {100 * item.overlap:.0f} %')
    if rival is None:
        return text + '; no rival'
    step = poses[rival] - poses[best]
    turn = np.degrees(wrap(step[2]))
    return text + (f'; best rival {np.hypot(step[0], step[1]):.1f} m and {abs(turn):.0f} deg away '
                   f'at {score[rival] / max(score[best], 1e-6):.2f}')


def judge_by_V(pose: Array, evidence: Evidence, threshold: float) -> Verdict:
    """Accept the only hypothesis (3,) if V of (12) reaches the threshold, as published."""
    accepted = evidence.V >= threshold
    return Verdict(0, None, np.array([evidence.V]), accepted,
                   f'{"accepted" if accepted else "refused"}: V is {100 * evidence.V:.1f} %, '
                   f'threshold {100 * threshold:.0f} %')
