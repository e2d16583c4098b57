# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a fusion node accepts now, as one JSON document and back.

A state says all that holds, so that what is missing in it no longer does, whatever was lost on
the way. Whatever is wrong with a document raises ValueError with one line.
"""

from collections.abc import Mapping
from dataclasses import replace
import json
import re
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint, sane_covariance
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.seal import decode_seal, encode_seal, record_of, Seal, UPPER
from somfusion_ros.team.shared_map import TUNING
from somfusion_ros.team.whereabouts import place_record, read_whereabouts, Whereabouts

VERSION = 2
MAX_STATE = 1 << 19      # bytes of a state; a constraint takes half a kilobyte at most
MAX_CONSTRAINTS = 256    # that one robot can have accepted
MAX_DEPARTED = 64        # robots that are gone
SESSION = re.compile(r'[0-9a-z]{1,32}')
KINDS = ('match', 'sighting')
LATEST = 1 << 62         # stamps [ns] and numbers are below


class TeamState(NamedTuple):
    """
    What a fusion node accepts now, and what it knows of robots that are gone.

    session changes whenever the node is started, number grows with every state of a session.
    epoch: which map the robot has now, None where it has none; since: stamp [ns] from which on its
    clusters are of that map. given: which map of it the user's initial pose is of, None where none
    was given. whereabouts: where it was when others were where. refuted: the robots
    whose bonds with it contradict its own views. seal: of its constraints and its epoch.
    denied: maps of robots of which the user's initial poses are not.
    """

    session: str
    constraints: tuple[MapConstraint, ...] = ()
    departed: tuple[DepartedRobot, ...] = ()
    epoch: Epoch | None = None
    since: int = 0
    number: int = 0
    whereabouts: tuple[Whereabouts, ...] = ()
    refuted: tuple[str, ...] = ()
    given: Epoch | None = None
    seal: Seal | None = None
    denied: Mapping[str, Epoch] = {}


def fitting(state: TeamState) -> TeamState:
    """
    Leave out what others would refuse, where a robot knows more than a state can say.

    Of robots that are gone those that had said least are told first: a seal is of all or nothing.
    """
    said = sorted(state.constraints, key=lambda one: one.kind != KINDS[0])[:MAX_CONSTRAINTS]
    room, departed = 2 * MAX_CONSTRAINTS - len(said), {}
    for gone in sorted(state.departed[:MAX_DEPARTED], key=lambda one: len(one.constraints)):
        size = len(gone.constraints)
        fits = size <= min(room, MAX_CONSTRAINTS)
        room -= size * fits
        departed[gone.robot] = gone if fits else replace(gone, constraints=(), seal=None)
    return state._replace(constraints=tuple(said), refuted=state.refuted[:MAX_DEPARTED],
                          departed=tuple(departed[robot] for robot in sorted(departed)))


def encode_state(state: TeamState) -> str:
    """Write a state; numbers keep every digit, so that all robots compute with the same."""
    return json.dumps({
        'version': VERSION, 'session': state.session, 'number': state.number,
        'epoch': _text(state.epoch), 'given': _text(state.given), 'since': state.since,
        'seal': encode_seal(state.seal),
        'denied': {robot: str(epoch) for robot, epoch in state.denied.items()},
        'constraints': [record_of(constraint) for constraint in state.constraints],
        'departed': [{'robot': gone.robot, 'epoch': str(gone.epoch), 'known': gone.known,
                      'seal': encode_seal(gone.seal),
                      'constraints': [record_of(constraint) for constraint in gone.constraints]}
                     for gone in state.departed],
        'whereabouts': [place_record(told) for told in state.whereabouts],
        'refuted': state.refuted})


def decode_state(text: str) -> TeamState:
    """Read a state."""
    if len(text) > MAX_STATE:
        raise ValueError(f'state of {len(text)} bytes is over {MAX_STATE}')
    try:
        record = json.loads(text)
        if record['version'] != VERSION:
            raise ValueError(f'state of version {str(record["version"])[:20]}, this is {VERSION}')
        return _state(record)
    except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f'state is not what a fusion node says: {repr(error)[:200]}') from error


def _state(record: dict[str, Any]) -> TeamState:
    """Read a state that has been parsed."""
    epoch, given = (None if one is None else Epoch.read(one)
                    for one in (record['epoch'], record.get('given')))
    constraints, gone = _constraints(record['constraints']), record['departed']
    if not isinstance(gone, list) or len(gone) > MAX_DEPARTED:
        raise ValueError(f'state of more than {MAX_DEPARTED} robots that are gone')
    departed = tuple(DepartedRobot(robot_name(one['robot']), _count(one['known']),
                                   _constraints(one['constraints']), Epoch.read(one['epoch']),
                                   decode_seal(one.get('seal')))
                     for one in gone)
    if len(constraints) + sum(len(one.constraints) for one in departed) > 2 * MAX_CONSTRAINTS:
        raise ValueError(f'state of more than {2 * MAX_CONSTRAINTS} constraints in all')
    return TeamState(_session(record['session']), constraints, departed, epoch,
                     _count(record['since']), _count(record['number']),
                     read_whereabouts(record.get('whereabouts', [])),
                     _names(record.get('refuted', [])), given, decode_seal(record.get('seal')),
                     _maps(record.get('denied', {})))


def _text(epoch: Epoch | None) -> str | None:
    """Write an epoch, where there is one."""
    return None if epoch is None else str(epoch)


def _names(values: Any) -> tuple[str, ...]:
    """Read names of robots."""
    if not isinstance(values, list) or len(values) > MAX_DEPARTED:
        raise ValueError(f'no list of at most {MAX_DEPARTED} robots')
    return tuple(map(robot_name, values))


def _maps(record: Any) -> dict[str, Epoch]:
    """Read maps by robot."""
    if not isinstance(record, dict) or len(record) > MAX_DEPARTED:
        raise ValueError(f'no maps of at most {MAX_DEPARTED} robots')
    return {robot_name(robot): Epoch.read(epoch) for robot, epoch in record.items()}


def _constraints(items: Any) -> tuple[MapConstraint, ...]:
    """Read constraints."""
    if not isinstance(items, list) or len(items) > MAX_CONSTRAINTS:
        raise ValueError(f'no list of at most {MAX_CONSTRAINTS} constraints')
    return tuple(_constraint(item) for item in items)


def _constraint(item: dict[str, Any]) -> MapConstraint:
    """Read one constraint."""
    pose = Pose(*_numbers(item['pose'], 3).tolist())   # as it is: to wrap an angle rounds it
    if max(abs(pose.x), abs(pose.y)) > TUNING.farthest or abs(pose.theta) > 4.0:
        raise ValueError(f'{pose.x:.3g}, {pose.y:.3g} is too far for the frame of a map')
    kind, (probability,) = item['kind'], _numbers([item['probability']], 1)
    if kind not in KINDS or not 0.0 <= probability <= 1.0:
        raise ValueError(f'constraint of kind {str(kind)[:20]!r}, probability {probability!r}')
    target, source = robot_name(item['target']), robot_name(item['source'])
    if target == source:
        raise ValueError(f'constraint from {target} to itself')
    first, second = (Epoch.read(text) for text in item['epochs'])
    return MapConstraint(target, source, pose, _covariance(item['covariance']),
                         float(probability), kind, (first, second))


def _covariance(upper: Any) -> Array:
    """Return the covariance (3, 3) of its upper triangle."""
    P = np.zeros((3, 3))
    P[UPPER] = _numbers(upper, 6)
    return sane_covariance(P + np.triu(P, 1).T)


def _numbers(values: Any, count: int) -> Array:
    """Check a list of finite numbers."""
    if not isinstance(values, list) or len(values) != count or not all(
            type(value) in (int, float) and abs(value) < LATEST for value in values):
        raise ValueError(f'not a list of {count} finite numbers')
    return np.array(values, dtype=float)


def _count(value: Any) -> int:
    """Check a whole number that is not negative."""
    if type(value) is not int or not 0 <= value < LATEST:
        raise ValueError('a number is none that counts something')
    return value


def _session(value: Any) -> str:
    """Check the name of a session."""
    if not isinstance(value, str) or not SESSION.fullmatch(value):
        raise ValueError('a session is no word of at most 32 letters')
    return value
