# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The verdict: a calibrated probability, accepted, refused or ambiguous, and a reason in words.

A hypothesis must pass three tests, and is as probable as its worst one lets it be: the walls that
should coincide do, once the maps may bend; it is better than every rival, in all and along the
direction with the least evidence; and enough distinct places fix it along that direction, which
two parallel walls do not. Each test is linear in measures that can only speak for a hypothesis
when they grow. The weights were learned from true and false hypotheses of real, cut, bent and
mirrored maps, simulated corridors and offices (benchmarks/calibration.py).
"""

from dataclasses import dataclass

import numpy as np

from somfusion_ros.fusion.features import Index, place
from somfusion_ros.fusion.verification import Evidence
from somfusion_ros.geometry import Array, wrap

SLIDES = (-4.0, -2.5, -1.6, -1.0, 1.0, 1.6, 2.5, 4.0)   # steps along a corridor [m]
APART = (0.7, np.radians(8.0))     # a rival lies further than this from the best [m, rad]
AGREEMENT = {'ratio': 1.01, 'fine_ratio': 3.83, 'little_against': 6.69, 'constant': 18.63}
DISTINCTION = {'margin': 9.48, 'weak_margin': 3.67, 'bent_margin': 1.0, 'constant': -2.37}
PLACES = {'weak': 4.42, 'weak_ratio': 4.66, 'constant': -9.89}


@dataclass(frozen=True)
class Margins:
    """How many times better than the best rival: in all, in the weakest direction, once bent."""

    margin: float
    weak_margin: float
    bent_margin: float


CLEAR = Margins(1.6, 3.0, 3.0)      # of a hypothesis without a rival worth the name


@dataclass(frozen=True)
class Verdict:
    """Best hypothesis and best rival (or None) with their probabilities, the verdict, and why."""

    best: int
    rival: int | None
    probability: float
    rival_probability: float
    accepted: bool
    reason: str
    margins: Margins = CLEAR


def slides(pose: Array, axis: Array) -> Array:
    """Return poses (8, 3) beside a hypothesis (3,), along the direction (2,) fixed worst."""
    steps = np.zeros((len(SLIDES), 3))
    steps[:, :2] = np.outer(SLIDES, axis)
    return pose + steps


def rivals(poses: Array, evidence: list[Evidence], best: int, pivot: Array) -> Index:
    """List the hypotheses (B, 3) that lie elsewhere than the best, strongest first."""
    spot = place(poses, pivot[None])[:, :, 0].T
    apart = np.hypot(*(spot - spot[best]).T) > APART[0]
    apart |= np.abs(wrap(poses[:, 2] - poses[best, 2])) > APART[1]
    found = np.flatnonzero(apart)
    return found[np.argsort([-evidence[k].score for k in found], kind='stable')]


def judge(poses: Array, evidence: list[Evidence], best: int, bent: Evidence, others: Index,
          confidence: float) -> Verdict:
    """
    Weigh the best of several hypotheses against the others.

    Parameters
    ----------
    poses, evidence : hypotheses (B, 3) with the evidence of each, the maps taken as rigid
    best : which of them is judged
    bent : its evidence when the maps may bend
    others : its rivals, strongest first
    confidence : probability from which it is accepted
    """
    margins, rival, back = CLEAR, None, 0.0
    if len(others):
        rival, mine = int(others[0]), evidence[best]
        weak = max(0.2, max(evidence[k].weak_score for k in others))
        margins = Margins(mine.score / max(evidence[rival].score, 1e-3), mine.weak_score / weak,
                          bent.weak_score / weak)
        against = evidence[rival].weak_score / max(bent.weak_score, 0.2)
        back = probability(evidence[rival],
                           Margins(1.0 / max(margins.margin, 1e-3), against, against))
    chance, alone = probability(bent, margins), probability(bent, CLEAR)
    word = 'refused' if chance < confidence else 'accepted'
    if chance < confidence <= alone:
        word = 'ambiguous'
    return Verdict(best, rival, chance, min(back, 1.0 - chance), chance >= confidence,
                   _reason(word, bent, poses, best, rival, margins.margin), margins)


def probability(item: Evidence, margins: Margins) -> float:
    """Chance that a hypothesis is right, from its evidence and its margins over rivals."""
    found = measures(item, margins)
    tests = [sum(weight * found[name] for name, weight in test.items())
             for test in (AGREEMENT, DISTINCTION, PLACES)]
    z = -np.logaddexp.reduce(np.negative(tests))     # a soft minimum
    return float(1.0 / (1.0 + np.exp(-np.clip(z, -30.0, 30.0))))


def measures(item: Evidence, margins: Margins) -> dict[str, float]:
    """Put evidence and margins on the scales on which the tests add them up."""
    against = item.matched * (1.0 / max(item.ratio, 0.05) - 1.0)
    return {
        'ratio': _logit(item.ratio), 'fine_ratio': _logit(item.fine_ratio),
        'little_against': -np.log(against + 5.0),
        'margin': np.log(np.clip(margins.margin, 0.8, 2.0)),
        'weak_margin': np.log(np.clip(margins.weak_margin, 0.3, 4.0)),
        'bent_margin': np.log(np.clip(margins.bent_margin, 0.3, 4.0)),
        'weak': np.log(item.weak + 0.3), 'weak_ratio': _logit(item.weak_ratio), 'constant': 1.0}


def judge_by_V(evidence: Evidence, threshold: float) -> Verdict:
    """Accept the only hypothesis if V of (12) reaches the threshold, as published."""
    accepted = evidence.V >= threshold
    return Verdict(0, None, evidence.V, 0.0, accepted,
                   f'{"accepted" if accepted else "refused"}: V is {100 * evidence.V:.1f} %, '
                   f'threshold {100 * threshold:.0f} %')


def _logit(share: float) -> float:
    """Log odds of a share, kept finite."""
    return float(np.log((share + 0.02) / (1.02 - share)))


def _reason(word: str, item: Evidence, poses: Array, best: int, rival: int | None,
            margin: float) -> str:
    """Say in one sentence, with numbers, what decided."""
    text = (f'{word}: walls agree {100 * item.ratio:.0f} % over {item.matched:.0f} m, '
            f'{100 * item.weak_ratio:.0f} % over {item.weak:.1f} m in the weakest direction, '
            f'overlap {100 * item.overlap:.0f} %')
    if rival is None:
        return text + '; no rival'
    step = poses[rival] - poses[best]
    return text + (f'; best rival {np.hypot(step[0], step[1]):.1f} m and '
                   f'{abs(np.degrees(wrap(step[2]))):.0f} deg away at '
                   f'{1.0 / max(margin, 0.01):.2f}')
