# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The verdict: a calibrated probability, accepted, refused or ambiguous, and a reason in words.

A hypothesis must pass three tests, and is as probable as its worst one lets it be. Agreement: the
walls that should coincide do, once the maps may bend, and hardly any straight wall stands where
the other map saw free space all around; furniture that moved is no contradiction. Distinction: it
is better than every rival, in how little wall speaks against it, and along the direction with the
least evidence. Places: distinct places agree along that direction, which two parallel walls do not
have, over much common ground or, over little, to a cell; and the rest of the maps can be reached
from there: it is not one room that happens to fit. Each test is linear in measures that can only
speak for a hypothesis when they grow, with weights learned from many (doc/verdict.md).
"""

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
import json

import numpy as np
from somfusion_ros.fusion.clusters import Index
from somfusion_ros.fusion.measures import Evidence
from somfusion_ros.geometry import Array, wrap
from somfusion_ros.settings import tuned

WEIGHTS_FILE = 'verdict_weights.json'
TESTS: dict[str, tuple[str, ...]] = {
    'agreement': ('solid_density', 'ratio', 'constant'),
    'distinction': ('odds', 'weak_lead', 'constant'),
    'places': ('weak_ratio', 'exact', 'overlap', 'common', 'passable', 'constant'),
}


@dataclass(frozen=True)
class VerdictSettings:
    """Numbers that the verdict was tuned with, beside its learned weights."""

    strip: float = tuned(
        0.1, 'share', 'of the smaller map from which an overlap is no thin strip',
        'benchmarks/fusion/calibration.py')
    power: float = tuned(
        0.5, '', 'of the wall that coincides, with which the odds against the best rival count: '
        'over much wall less of a difference tells; of 0.25, 0.4 and 0.55 it accepts most',
        'benchmarks/fusion/calibration.py')
    ahead: float = tuned(
        3.0, 'root m', 'of lead along the direction with the least evidence, or more, are enough',
        'benchmarks/fusion/calibration.py')
    cut: float = tuned(
        0.1, 'share', 'of a map that is not reached: below, it is drift, or holes in walls',
        'benchmarks/fusion/calibration.py')
    noise: float = tuned(
        0.05, 'share', 'of wall that the other map saw free: below, it is noise', 'by design')
    little: float = tuned(3.0, 'm2, m', 'of common area, or wall, are as nothing', 'by design')
    sure: float = tuned(
        0.9, 'probability', 'from which a verdict over all measured rivals is clear, and',
        'benchmarks/fusion/stages.py')
    clear_margin: float = tuned(
        3.0, 'times', 'as good as the best rival: then no rival is bent, which takes time',
        'benchmarks/fusion/stages.py')
    comparable: float = tuned(
        0.6, 'share', "of the best's wall that a rival matches to be compared by its conflicts: "
        'a small overlap that fits by chance has few', 'benchmarks/fusion/calibration.py')
    close: float = tuned(
        0.9, 'share', "of the best's score from which a rival is compared so however little wall "
        'it matches; at 0.8 bent maps lose to small overlaps', 'doc/verdict.md')
    loose_wall: float = tuned(
        0.5, 'm', 'of straight wall in the open is no contradiction: half a door leaf',
        'doc/verdict.md: belgioioso halves')
    image: float = tuned(
        1.5, 'times', 'as good as a hypothesis is the mirror image of one map where the places '
        'are built the other way round; at most 1.04 in true pairs', 'doc/verdict.md: mirrored')
    image_chance: float = tuned(
        0.02, 'probability', 'of a hypothesis that its image beats', 'by design')


VERDICT = VerdictSettings()


@dataclass(frozen=True)
class Margins:
    """How many times better than the best rival: by score, wall against, weakest direction."""

    margin: float
    odds: float
    weak_margin: float


CLEAR = Margins(3.0, 20.0, 4.0)      # of a hypothesis without a rival worth the name


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """
    What was decided.

    best and rival: numbers of hypotheses (rival None where there is none) with their
    probabilities; ambiguous: the best would be accepted but for its rivals.
    """

    best: int
    rival: int | None
    probability: float
    rival_probability: float
    accepted: bool
    reason: str
    ambiguous: bool = False
    margins: Margins = CLEAR

    @property
    def is_clear(self) -> bool:
        """Whether it would stand, however rivals were bent or moved along a corridor."""
        return (self.accepted and self.probability >= VERDICT.sure
                and self.margins.margin >= VERDICT.clear_margin)


@cache
def weights() -> dict[str, dict[str, float]]:
    """Return the learned weights of every measure, by test."""
    text = (files('somfusion_ros.fusion') / WEIGHTS_FILE).read_text(encoding='utf-8')
    learned: dict[str, dict[str, float]] = json.loads(text)['weights']
    return learned


def judge(poses: Array, evidence: list[Evidence], best: int, others: Index,
          confidence: float) -> Verdict:
    """
    Weigh the best of several hypotheses against the others.

    poses, evidence: hypotheses (B, 3) with the evidence of each; best: which of them is judged;
    others: its rivals, strongest first; confidence: probability from which it is accepted.
    """
    margins, rival, back = CLEAR, None, 0.0
    if len(others):
        rival = int(others[0])
        margins = margins_over(evidence[best], [evidence[k] for k in others])
        back = probability(evidence[rival], margins_over(evidence[rival], [evidence[best]]))
    chance, alone = probability(evidence[best], margins), probability(evidence[best], CLEAR)
    word = 'refused' if chance < confidence else 'accepted'
    if chance < confidence <= alone:
        word = 'ambiguous'
    return Verdict(best=best, rival=rival, probability=chance,
                   rival_probability=min(back, 1.0 - chance), accepted=chance >= confidence,
                   reason=_reason(word, evidence[best], poses, best, rival, margins.margin),
                   ambiguous=word == 'ambiguous', margins=margins)


def margins_over(item: Evidence, rivals_of_it: list[Evidence]) -> Margins:
    """Compare a hypothesis with its rivals, at least one."""
    odds = [_against(other) for other in rivals_of_it
            if other.fine > VERDICT.comparable * item.fine
            or other.score > VERDICT.close * item.score]
    return Margins(
        item.score / max(max(other.score for other in rivals_of_it), 1e-9),
        min(odds, default=5.0) / _against(item),
        item.weak_score / max(max(other.weak_score for other in rivals_of_it), 0.2))


def _against(item: Evidence) -> float:
    """Return the wall that speaks against a hypothesis, per wall that speaks for it."""
    return (item.fine_against + 0.5) / (item.fine + 0.5)


def probability(item: Evidence, margins: Margins) -> float:
    """Return chance that a hypothesis is right, from its evidence and its margins over rivals."""
    found = measures(item, margins)
    log_odds = [sum(weights()[test][name] * found[name] for name in names)
                for test, names in TESTS.items()]
    return float(chance_of(soft_minimum(np.array(log_odds))))


def soft_minimum(log_odds: Array) -> Array:
    """Join the log odds of several tests (T, ...): about the least of them, and a little less."""
    return np.asarray(-np.logaddexp.reduce(np.negative(log_odds), axis=0))


def chance_of(log_odds: Array) -> Array:
    """Return the probability of log odds, any shape."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -30.0, 30.0))))


def measures(item: Evidence, margins: Margins) -> dict[str, float]:
    """Put evidence and margins on the scales on which the tests add them up."""
    return {
        'solid_density': -np.log(
            max(item.solid_against - VERDICT.loose_wall, 0.0) / (item.common + 10.0) + 0.01),
        'ratio': _logit(item.ratio),
        'odds': np.clip(np.log(np.clip(margins.odds, 0.1, 20.0))
                        * (item.fine + VERDICT.little) ** VERDICT.power, -6.0, 8.0),
        'weak_lead': np.clip(item.weak_score * (1.0 - 1.0 / max(margins.weak_margin, 0.3)),
                             -1.0, VERDICT.ahead),
        'weak_ratio': _logit(item.weak_ratio),
        'exact': -np.log(VERDICT.noise + item.fine_against / (item.fine + VERDICT.little)),
        'overlap': np.log(np.clip(item.overlap / VERDICT.strip, 0.05, 1.0)),
        'common': np.log(item.common + VERDICT.little),
        'passable': -np.log(1.0 + VERDICT.cut - item.passable), 'constant': 1.0}


def judge_by_V(evidence: Evidence, threshold: float) -> Verdict:
    """Accept the only hypothesis if V of (12) reaches the threshold, as published."""
    accepted = evidence.V >= threshold
    return Verdict(best=0, rival=None, probability=evidence.V, rival_probability=0.0,
                   accepted=accepted,
                   reason=f'{"accepted" if accepted else "refused"}: V is '
                   f'{100 * evidence.V:.1f} %, threshold {100 * threshold:.0f} %')


def beside_image(verdict: Verdict, item: Evidence, image: Verdict,
                 image_item: Evidence) -> Verdict:
    """
    Refuse a hypothesis where the mirror image of the source map fits much better than it.

    verdict, item: on the hypothesis, and the evidence for it; image, image_item: on the best pose
    of the mirror image, and the evidence for that.
    """
    times = image_times(item, image, image_item)
    if times < VERDICT.image:
        return verdict
    reason = (f'refused: the mirror image of one map fits {times:.1f} times as well, so the '
              'places are built alike, one the other way round;'
              + verdict.reason.partition(':')[2])
    return replace(verdict, accepted=False, reason=reason,
                   probability=min(verdict.probability, VERDICT.image_chance))


def image_times(item: Evidence, image: Verdict, image_item: Evidence) -> float:
    """Return how many times as well the mirror image fits, 0 where it does not fit at all."""
    return image_item.score / max(item.score, 1e-3) if image.accepted else 0.0


def _logit(share: float) -> float:
    """Log odds of a share, kept finite."""
    return float(np.log((share + 0.02) / (1.02 - share)))


def _reason(word: str, item: Evidence, poses: Array, best: int, rival: int | None,
            margin: float) -> str:
    """Say in one sentence, with numbers, what decided."""
    text = (f'{word}: walls agree {100 * item.ratio:.0f} % over {item.matched:.0f} m, '
            f'{100 * item.weak_ratio:.0f} % over {item.weak:.1f} m in the weakest direction, '
            f'overlap {100 * item.overlap:.0f} %, {item.solid_against:.1f} m of straight wall '
            f'in the open, {100 * item.passable:.0f} % reached from there')
    if rival is None:
        return text + '; no rival'
    step = poses[rival] - poses[best]
    return text + (f'; best rival {np.hypot(step[0], step[1]):.1f} m and '
                   f'{abs(np.degrees(wrap(step[2]))):.0f} deg away at '
                   f'{1.0 / max(margin, 0.01):.2f}')
