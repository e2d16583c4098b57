# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The verdict: a calibrated probability, accepted, refused or ambiguous, and a reason in words.

A hypothesis must pass three tests, and is as probable as its worst one lets it be: the walls that
should coincide do, once the maps may bend; it is better than every rival, in all, in how little
wall speaks against it, and along the direction with the least evidence; and enough distinct
places fix it along that direction, which two parallel walls do not, in an overlap that is no thin
strip, where walls coincide by chance. Each test is linear in measures that can only speak for a
hypothesis when they grow. The weights were learned from true and false hypotheses of real, cut,
bent, worn and mirrored maps, drawn corridors, offices and buildings
(benchmarks/fusion/calibration.py).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.fusion.measures import Evidence
from somfusion_ros.geometry import Array, place, wrap

SLIDES = (-4.0, -2.5, -1.6, -1.0, 1.0, 1.6, 2.5, 4.0)   # steps along a corridor [m]
APART = (0.7, np.radians(8.0))     # a rival lies further than this from the best [m, rad]
ENOUGH = 0.1       # share of the smaller map from which an overlap is no thin strip
SURE = 0.995       # probability from which a verdict over all measured rivals is clear
SPAN = 250.0       # of more wall than this as much may be wrong as if there were so much [m]
COMPARABLE = 0.4   # a rival that matches less of the best's wall tells nothing of its conflicts
AGREEMENT = {'ratio': 3.08, 'fine_ratio': 0.32, 'little_against': 11.52, 'constant': 45.44}
DISTINCTION = {'margin': 1.27, 'odds': 8.11, 'weak_margin': 5.26, 'constant': -7.33}
PLACES = {'weak': 1.86, 'weak_ratio': 4.29, 'overlap': 5.98, 'constant': -4.01}


@dataclass(frozen=True)
class Margins:
    """How many times better than the best rival: by score, wall against, weakest direction."""

    margin: float
    odds: float
    weak_margin: float


CLEAR = Margins(3.0, 20.0, 4.0)      # of a hypothesis without a rival worth the name


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Best hypothesis and best rival (or None) with their probabilities, the verdict, and why."""

    best: int
    rival: int | None
    probability: float
    rival_probability: float
    accepted: bool
    reason: str
    margins: Margins = CLEAR

    @property
    def is_clear(self) -> bool:
        """Whether it would stand, however rivals were bent or moved along a corridor."""
        return self.probability >= SURE and self.margins.margin >= CLEAR.margin


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


def judge(poses: Array, evidence: list[Evidence], best: int, bent: Mapping[int, Evidence],
          others: Index, confidence: float) -> Verdict:
    """
    Weigh the best of several hypotheses against the others.

    Parameters
    ----------
    poses, evidence : hypotheses (B, 3) with the evidence of each, the maps taken as rigid
    best : which of them is judged
    bent : the evidence of the best, and of some rivals, when the maps may bend
    others : its rivals, strongest first
    confidence : probability from which it is accepted
    """
    margins, rival, back = CLEAR, None, 0.0
    if len(others):
        rival = int(others[0])
        rigid = [evidence[k] for k in others]
        margins = margins_over(bent[best], evidence[best], rigid,
                               [bent[k] for k in others if k in bent])
        theirs = bent.get(rival, evidence[rival])
        back = probability(theirs, margins_over(theirs, evidence[rival], [evidence[best]],
                                                [bent[best]]))
    chance, alone = probability(bent[best], margins), probability(bent[best], CLEAR)
    word = 'refused' if chance < confidence else 'accepted'
    if chance < confidence <= alone:
        word = 'ambiguous'
    return Verdict(best=best, rival=rival, probability=chance,
                   rival_probability=min(back, 1.0 - chance), accepted=chance >= confidence,
                   reason=_reason(word, bent[best], poses, best, rival, margins.margin),
                   margins=margins)


def margins_over(bent: Evidence, rigid: Evidence, rivals: list[Evidence],
                 bent_rivals: list[Evidence]) -> Margins:
    """Compare a hypothesis, bent and rigid, with its rivals, at least one."""
    every = rivals + bent_rivals
    odds = [_against(item) for item in every if item.fine > COMPARABLE * bent.fine]
    return Margins(bent.score / max(max(item.score for item in every), 1e-9),
                   min(odds, default=5.0) / _against(bent),
                   rigid.weak_score / max(max(item.weak_score for item in rivals), 0.2))


def _against(item: Evidence) -> float:
    """Wall that speaks against a hypothesis, per wall that speaks for it."""
    return (item.fine_against + 0.5) / (item.fine + 0.5)


def probability(item: Evidence, margins: Margins) -> float:
    """Chance that a hypothesis is right, from its evidence and its margins over rivals."""
    found = measures(item, margins)
    tests = [sum(weight * found[name] for name, weight in test.items())
             for test in (AGREEMENT, DISTINCTION, PLACES)]
    z = -np.logaddexp.reduce(np.negative(tests))     # a soft minimum
    return float(1.0 / (1.0 + np.exp(-np.clip(z, -30.0, 30.0))))


def measures(item: Evidence, margins: Margins) -> dict[str, float]:
    """Put evidence and margins on the scales on which the tests add them up."""
    against = item.fine_against * min(1.0, SPAN / max(item.fine + item.fine_against, 1.0))
    return {
        'ratio': _logit(item.ratio), 'fine_ratio': _logit(item.fine_ratio),
        'little_against': -np.log(against + 3.0),
        'margin': np.log(np.clip(margins.margin, 0.7, 3.0)),
        'odds': np.log(np.clip(margins.odds, 0.1, 20.0)),
        'weak_margin': np.log(np.clip(margins.weak_margin, 0.3, 4.0)),
        'weak': np.log(item.weak + 0.3), 'weak_ratio': _logit(item.weak_ratio),
        'overlap': np.log(np.clip(item.overlap / ENOUGH, 0.05, 1.0)), 'constant': 1.0}


def judge_by_V(evidence: Evidence, threshold: float) -> Verdict:
    """Accept the only hypothesis if V of (12) reaches the threshold, as published."""
    accepted = evidence.V >= threshold
    return Verdict(best=0, rival=None, probability=evidence.V, rival_probability=0.0,
                   accepted=accepted,
                   reason=f'{"accepted" if accepted else "refused"}: V is '
                   f'{100 * evidence.V:.1f} %, threshold {100 * threshold:.0f} %')


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
