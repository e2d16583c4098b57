# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Is a hypothesis right? (section III-C, equations (10)-(12), and a calibrated verdict).

V of (12) cannot tell right from wrong where the overlap is small, so several measures decide
together: how much wall is matched, how much wall should be seen and is not, how well the
direction with the least evidence is fixed (two parallel walls fit into every corridor of that
width), how much of the smaller map lies on the other one, and the best rival.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from somfusion_ros.fusion.features import Clusters, Map, match_at, place, Warp
from somfusion_ros.geometry import Array, inverse, rotation, wrap

TOLERANCE = 0.2        # a wall within this distance of another is the same [m]
ANGLE = np.radians(25.0)
SLIDES = (-4.0, -2.5, -1.6, -1.0, 1.0, 1.6, 2.5, 4.0)   # steps along a corridor [m]


@dataclass(frozen=True)
class Evidence:
    """
    Measures of one hypothesis.

    matched: wall that coincides, mean of both maps [m]; ratio: matched / (matched + wall that
    the other map saw as free); overlap: share of the smaller map's free area that the other map
    knows; weak, weak_ratio: the same as matched and ratio for the direction with the least
    evidence, which `axis` (2,) is, in the target's frame; V of (12) [0..1].
    """

    matched: float
    ratio: float
    overlap: float
    weak: float
    weak_ratio: float
    V: float
    axis: Array

    @property
    def weak_score(self) -> float:
        """Same as `score` for the direction with the least evidence."""
        return self.weak_ratio * np.sqrt(self.weak)

    @property
    def score(self) -> float:
        """Matched ratio times the root of the matched length."""
        return self.ratio * np.sqrt(self.matched)


def scores(poses: Array, target: Map, source: Map, tolerance: float = TOLERANCE,
           every: int = 1) -> Array:
    """Score (B,) of hypotheses (B, 3) as `Evidence.score`, from every n-th cluster of both."""
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        clusters = seen.clusters.take(np.s_[::every])
        away = by.clearance.at(place(way, clusters.centres))
        total += _tally(away, clusters, tolerance)
    matched, against = total * every / 2.0
    return matched / (matched + against + 1.0) * np.sqrt(matched)


def _tally(away: Array, clusters: Clusters, tolerance: float) -> Array:
    """Length (2, B) [m] of wall that lies on a wall, and that lies on free space."""
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


def measure(pose: Array, target: Map, source: Map, warp: Warp | None = None,
            tolerance: float = TOLERANCE) -> Evidence:
    """Take all measures of one hypothesis (3,), of the source as it is or bent by a warp."""
    T = Overlay(np.asarray(pose, dtype=float), warp)
    length, info, votes, shares = np.zeros(2), np.zeros((2, 2, 2)), np.zeros(2), []
    for lay, turn, seen, by in ((T.forth, T.pose[2], source, target),
                                (T.back, -T.pose[2], target, source)):
        length += _tally(by.clearance.at(lay(seen.clusters.centres)), seen.clusters,
                         tolerance)[:, 0] / 2.0
        R = rotation(T.pose[2]) if seen is source else np.eye(2)
        info += R @ _information(lay, turn, seen, by, tolerance) @ R.T / 2.0
        share, vote = _free_agreement(lay(seen.free), by)
        shares.append(share)
        votes += vote
    (matched, against), (weak, axes) = length, np.linalg.eigh(info[0])
    held, lost = max(float(weak[0]), 0.0), float(axes[:, 0] @ info[1] @ axes[:, 0])
    return Evidence(matched, matched / (matched + against + 1.0), max(shares), held,
                    held / (held + lost + 0.5), float(votes[0] / max(votes.sum(), 1.0)),
                    axes[:, 0])


@dataclass(frozen=True, eq=False)
class Overlay:
    """A pose (3,) and a warp in the target's frame, applied forth and back."""

    pose: Array
    warp: Warp | None

    def forth(self, points: Array) -> Array:
        """Lay source points (K, 2) on the target: (2, 1, K)."""
        at = place(self.pose[None], points)
        return at if self.warp is None else at + self.warp.at(at)

    def back(self, points: Array) -> Array:
        """Lay target points (K, 2) on the source: (2, 1, K)."""
        if self.warp is not None:
            points = points - self.warp.at(points.T.astype(np.float32)).T
        return place(inverse(self.pose)[None], points)


def _information(lay: Callable[[Array], Array], turn: float, seen: Map, by: Map,
                 tolerance: float) -> Array:
    """Sum (2, 2, 2) of w n n' over matched clusters, and over those on free space [m]."""
    clusters = seen.features
    at = lay(clusters.centres)
    found = match_at(at, np.array([turn]), clusters, by.features, by.nearest, ANGLE, 0.8)
    on = (found.agrees & (np.abs(found.off) <= tolerance))[0]
    off = by.clearance.at(at)[0] > tolerance
    weight = clusters.weights * clusters.straight
    return np.stack([(clusters.norms * (weight * which)[:, None]).T @ clusters.norms
                     for which in (on, off)])


def _free_agreement(at: Array, by: Map) -> tuple[float, Array]:
    """Share of free places (2, 1, F) that the other map knows; how many agree, disagree."""
    away = by.clearance.at(at)[0]
    wall = np.abs(away) < 0.6 * by.clearance.resolution
    free = (away > 0) & ~wall
    return float((wall | free).mean()), np.array([free.sum(), wall.sum()], dtype=float)


def slides(pose: Array, axis: Array) -> Array:
    """Poses (8, 3) beside a hypothesis (3,), along the direction (2,) that is fixed worst."""
    steps = np.zeros((len(SLIDES), 3))
    steps[:, :2] = np.outer(SLIDES, axis)
    return pose + steps


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
