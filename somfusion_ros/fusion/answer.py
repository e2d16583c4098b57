# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The answer to the question where one map lies in another."""

from dataclasses import dataclass, field, replace

import numpy as np
from somfusion_ros.geometry import Array, inverse, Pose


@dataclass(frozen=True)
class RunnerUp:
    """The best rival of an alignment that lies at a clearly different pose."""

    T_target_source: Pose
    probability: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """
    The verdict on one pair of maps.

    Attributes
    ----------
    accepted : bool
        Whether the pose is to be used: `probability` reaches `estimation_confidence`.
    probability : float
        Chance that the pose is right, 0..1.
    reason : str
        One sentence with the numbers that decided.
    T_target_source : Pose or None
        Best pose found of the source map in the target map (m, m, rad), also when refused.
    covariance : (3, 3) array
        Of the pose (m, m, rad) in the target's frame.
    verification_index : float
        V of the paper's equation (12) [%].
    performance_index : tuple of float
        J of equation (10) after each iteration [m].
    overlap : float
        Share of the smaller map that lies on the other one, 0..1.
    runner_up : RunnerUp or None
        The best rival.
    lookout_target, lookout_source : Pose or None
        Where the verdict is ambiguous: the pose in the frame of either map from which a robot
        would see which of the two candidates is right; None where no such place is known.
    seconds : dict of str to float
        Time per stage [s].
    """

    accepted: bool
    probability: float
    reason: str
    T_target_source: Pose | None = None
    covariance: Array = field(default_factory=lambda: np.full((3, 3), np.inf))
    verification_index: float = 0.0
    performance_index: tuple[float, ...] = ()
    overlap: float = 0.0
    runner_up: RunnerUp | None = None
    lookout_target: Pose | None = None
    lookout_source: Pose | None = None
    seconds: dict[str, float] = field(default_factory=dict)


def named(answer: Alignment) -> Alignment:
    """Name both candidates of an ambiguous answer, and what would settle it, in its reason."""
    if (not answer.reason.startswith('ambiguous') or answer.runner_up is None
            or answer.T_target_source is None):
        return answer
    either, other = (f'({pose.x:.1f}, {pose.y:.1f}, {np.degrees(pose.theta):.0f} deg)'
                     for pose in (answer.T_target_source, answer.runner_up.T_target_source))
    words = [f'from ({place.x:.1f}, {place.y:.1f}) of the {name} map'
             for name, place in (('target', answer.lookout_target),
                                 ('source', answer.lookout_source)) if place is not None]
    where = ('; a look ' + ' or '.join(words) + ' would settle it') if words else ''
    return replace(answer, reason=f'{answer.reason}; the source lies at {either} or {other}'
                   f'{where}')


def turned_round(answer: Alignment) -> Alignment:
    """Return the same answer for target and source exchanged."""
    T = answer.T_target_source
    if T is None:
        return answer
    c, s = np.cos(T.theta), np.sin(T.theta)
    # d inverse(T) / dT: the covariance follows the pose into the other frame.
    back = inverse(T)
    J = np.array([[-c, -s, back[1]], [s, -c, -back[0]], [0.0, 0.0, -1.0]])
    rival = answer.runner_up
    if rival is not None:
        rival = replace(rival, T_target_source=Pose(*inverse(rival.T_target_source).tolist()))
    return replace(answer, T_target_source=Pose(*back.tolist()), runner_up=rival,
                   lookout_target=answer.lookout_source, lookout_source=answer.lookout_target,
                   covariance=J @ answer.covariance @ J.T)
