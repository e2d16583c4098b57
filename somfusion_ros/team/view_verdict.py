# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What views add to the verdict on two grids.

Grids of small parts, or of bent ones, leave a verdict open that the views can give: at the right
pose nearly all that should see the peer's surface find it there and nowhere else, at a wrong one
few do. Each view's answer multiplies the odds, but views that overlap answer alike, so their
logarithm counts in part only, and within bounds: nothing is so sure that grids no longer count.
"""

from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.settings import tuned
from somfusion_ros.team.bond import Bond


@dataclass(frozen=True)
class ViewVerdictSettings:
    """How much a view's answer is worth."""

    true_share: float = tuned(0.9, '', 'of the views that confirm a pose that is right',
                              'parts of the shared teams')
    false_share: float = tuned(0.3, '', 'of the views that confirm one that is wrong',
                               'parts of the shared teams')
    worth: float = tuned(0.25, '', 'of the answer of a view, since four are matched together',
                         'by design')
    most: float = tuned(6.0, '', 'logarithm of the odds that views give at most, 400 to 1',
                        'by design')
    clear: float = tuned(0.995, '', 'probability of the grids from which the views of a rival '
                         'need not be asked', 'as for rivals of the grids')
    fixed: float = tuned(0.1, 'm', 'sigma of the weakest direction from which views speak for '
                         'a pose', 'parts of the shared teams')


RULES = ViewVerdictSettings()


def log_odds(bond: Bond) -> float:
    """Return the log odds that a right pose, not a wrong one, would give a bond's answers."""
    yes, no = bond.confirmation.confirmed, bond.confirmation.asked - bond.confirmation.confirmed
    per_yes = np.log(RULES.true_share / RULES.false_share)
    per_no = np.log((1.0 - RULES.true_share) / (1.0 - RULES.false_share))
    answer = float(np.clip(RULES.worth * (yes * per_yes + no * per_no), -RULES.most, RULES.most))
    return answer if bond.weakest <= RULES.fixed else min(answer, 0.0)


def could_matter(probability: float, confidence: float) -> bool:
    """Return whether views can turn a verdict of some probability."""
    return _logit(probability) + RULES.most >= _logit(confidence)


def judge_views(alignment: Alignment, bond: Bond, rival: Bond | None, confidence: float
                ) -> Alignment:
    """
    Weigh a verdict on grids anew with what the views say.

    Parameters
    ----------
    alignment : the verdict on the grids
    bond : what the views say of its pose
    rival : what they say of the runner-up's pose, where there is one
    confidence : probability from which a pose is accepted
    """
    if not bond.confirmation.asked:
        return alignment
    against = max(log_odds(rival), 0.0) if rival else 0.0
    odds = _logit(alignment.probability) + log_odds(bond) - against
    probability = float(1.0 / (1.0 + np.exp(-odds)))
    accepted = probability >= confidence
    _, _, said = alignment.reason.partition(': ')
    said = f'{"accepted" if accepted else "refused"}: {bond.reason}; {said}'
    if against and rival is not None:
        said += (f'; {rival.confirmation.confirmed} of {rival.confirmation.asked} views confirm '
                 'the rival')
    return replace(alignment, accepted=accepted, probability=probability, reason=said)


def _logit(probability: float) -> float:
    """Return the logarithm of odds, kept finite."""
    p = float(np.clip(probability, 1e-9, 1.0 - 1e-9))
    return float(np.log(p / (1.0 - p)))
