# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How right the pose is that was found for a pair of maps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, Array, wrap

RIGHT = (0.5, np.radians(5.0))    # [m], [rad]: close enough to be refined or driven by
STRICT = (0.1, np.radians(1.0))   # [m], [rad]: walls lie on walls


@dataclass(frozen=True)
class PairScore:
    """
    One pair of maps: whether it is of one place, what was found, and how far that is off.

    The error [m] is taken at the centre of the true overlap, where it counts; inf without a pose.
    """

    true: bool
    accepted: bool
    error: float = np.inf
    turn: float = np.inf
    seconds: float = 0.0

    @property
    def right(self) -> bool:
        """Tell whether the pose is right, accepted or not."""
        return self.true and self.error < RIGHT[0] and self.turn < RIGHT[1]

    @property
    def strict(self) -> bool:
        """Tell whether the pose is right to a cell or two."""
        return self.true and self.error < STRICT[0] and self.turn < STRICT[1]


def score_pair(truth: Array | None, centre: Array | None, pose: Array | None, accepted: bool,
               seconds: float = 0.0) -> PairScore:
    """Compare a pose (3,) with the truth (3,), None for different places, at a point (2,) [m]."""
    if truth is None or centre is None or pose is None:
        return PairScore(truth is not None, accepted, seconds=seconds)
    found, wanted = (apply(T, [centre])[0] for T in (pose, truth))
    return PairScore(True, accepted, float(np.hypot(*(found - wanted))),
                     float(abs(wrap(pose[2] - truth[2]))), seconds)


def summary(scores: Sequence[PairScore]) -> dict[str, float]:
    """
    Return shares and counts of a set of pairs.

    right, strict: share of true pairs whose best pose is right, accepted or not; success: right
    and accepted; wrong: accepted wrong poses of true pairs; false: accepted pairs of different
    places; error [m] and turn [deg]: medians where right; ms: median and p95 per pair.
    """
    true = [score for score in scores if score.true]
    right = [score for score in true if score.right]
    ms = 1e3 * np.array([score.seconds for score in scores])
    return {
        'true': len(true), 'different': len(scores) - len(true),
        'right': _share(score.right for score in true),
        'strict': _share(score.strict for score in true),
        'success': _share(score.right and score.accepted for score in true),
        'wrong': sum(score.accepted and not score.right for score in true),
        'false': sum(score.accepted for score in scores if not score.true),
        'error': float(np.median([score.error for score in right])) if right else np.nan,
        'turn': float(np.degrees(np.median([s.turn for s in right]))) if right else np.nan,
        'ms': float(np.median(ms)), 'p95': float(np.percentile(ms, 95))}


def _share(flags: object) -> float:
    """Return the share of flags that are set."""
    found = list(flags)
    return float(np.mean(found)) if found else np.nan
