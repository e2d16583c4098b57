# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a fusion node accepts now, as one JSON document and back.

A state says all that holds, so that what is missing in it no longer does, whatever was lost on
the way. Whatever is wrong with a document raises ValueError with one line.
"""

from collections.abc import Iterable
import json
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.departed import DepartedRobot
from somfusion_ros.team.shared_map import TUNING

MAX_STATE = 1 << 18      # bytes of a state; a constraint takes a quarter of a kilobyte
MAX_CONSTRAINTS = 256    # that one robot can have accepted
MAX_NAME = 128           # letters of a robot's name
KINDS = ('match', 'sighting')
UPPER = np.triu_indices(3)
LEAST_VARIANCE, MOST_VARIANCE = 10 ** -12, 10 ** 12   # [m^2, rad^2]


class TeamState(NamedTuple):
    """
    What a fusion node accepts now, and what it knows of robots that are gone.

    session changes whenever the node is started.
    """

    session: str
    constraints: tuple[MapConstraint, ...]
    departed: tuple[DepartedRobot, ...] = ()


def encode_state(state: TeamState) -> str:
    """Write a state; numbers keep every digit, so that all robots compute with the same."""
    return json.dumps({
        'session': state.session,
        'constraints': [_record(constraint) for constraint in state.constraints],
        'departed': [{'robot': gone.robot, 'known': gone.known,
                      'constraints': [_record(constraint) for constraint in gone.constraints]}
                     for gone in state.departed]})


def decode_state(text: str) -> TeamState:
    """Read a state."""
    if len(text) > MAX_STATE:
        raise ValueError(f'state of {len(text)} bytes is over {MAX_STATE}')
    try:
        record = json.loads(text)
        return TeamState(_word(record['session']), _constraints(record['constraints']), tuple(
            DepartedRobot(_word(item['robot']), int(item['known']),
                          _constraints(item['constraints']))
            for item in record['departed']))
    except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f'state is not what a fusion node says: {error!r}') from error


def _record(constraint: MapConstraint) -> dict[str, Any]:
    """Write one constraint."""
    return {'target': constraint.target, 'source': constraint.source, 'kind': constraint.kind,
            'pose': list(constraint.T_target_source), 'probability': float(constraint.probability),
            'covariance': constraint.covariance[UPPER].tolist()}


def _constraints(items: list[dict[str, Any]]) -> tuple[MapConstraint, ...]:
    """Read constraints."""
    if len(items) > MAX_CONSTRAINTS:
        raise ValueError(f'state of {len(items)} constraints is over {MAX_CONSTRAINTS}')
    return tuple(_constraint(item) for item in items)


def _constraint(item: dict[str, Any]) -> MapConstraint:
    """Read one constraint."""
    pose = Pose.from_array(item['pose'])
    if max(abs(pose.x), abs(pose.y)) > TUNING.farthest:
        raise ValueError(f'{pose.x:.3g}, {pose.y:.3g} is too far for the frame of a map')
    kind, probability = item['kind'], item['probability']
    if kind not in KINDS or not 0.0 <= float(probability) <= 1.0:
        raise ValueError(f'constraint of kind {kind!r}, probability {probability!r}')
    target, source = _word(item['target']), _word(item['source'])
    if target == source:
        raise ValueError(f'constraint from {target} to itself')
    return MapConstraint(target, source, pose, _covariance(item['covariance']),
                         float(probability), kind)


def _covariance(upper: Iterable[float]) -> Array:
    """Covariance (3, 3) of its upper triangle."""
    values = np.array(upper, dtype=float)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ValueError('covariance is not six finite numbers')
    P = np.zeros((3, 3))
    P[UPPER] = values
    P += np.triu(P, 1).T
    variances = np.linalg.eigvalsh(P)
    if not LEAST_VARIANCE < variances[0] <= variances[-1] < MOST_VARIANCE:
        raise ValueError(f'covariance has variances {variances.tolist()}')
    return P


def _word(value: Any) -> str:
    """Check a name."""
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME:
        raise ValueError('a name is no word of at most 128 letters')
    return value
