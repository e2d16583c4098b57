# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One voice per robot and pair: all that one author says of two maps, made one constraint.

A robot that says a thing twice, or as a match and as a sighting, is not to outvote two others.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri
from somfusion_ros.geometry import Pose, wrap
from somfusion_ros.team.constraint import (Dropped, information_of, MapConstraint, TUNING,
                                           turned, with_drift)

TWICE = 2      # so many sightings that agree outweigh a match
SIGHTINGS = 5  # newest ones of a peer that are kept


def seen_elsewhere(match: MapConstraint, sightings: Iterable[MapConstraint]) -> bool:
    """Return whether sightings that agree with one another contradict a match of their author."""
    return any(one.constraint.kind == 'match' for one in one_voice_each([match, *sightings])[1])


def newest(said: Iterable[MapConstraint]) -> tuple[MapConstraint, ...]:
    """Return of every pair the last match that an author told, and its newest sightings."""
    matches: dict[frozenset[str], MapConstraint] = {}
    sightings: dict[frozenset[str], deque[MapConstraint]] = {}
    for one in said:
        pair = frozenset(one.robots)
        if one.kind == 'match':
            matches[pair] = one
        else:
            sightings.setdefault(pair, deque(maxlen=SIGHTINGS)).append(one)
    return (*matches.values(), *(one for few in sightings.values() for one in few))


def one_voice_each(constraints: Iterable[MapConstraint],
                   ) -> tuple[list[MapConstraint], list[Dropped]]:
    """
    Merge what each author says of each pair; return that, and what contradicts it.

    What the user gave counts before sightings that agree, and these before a match: who saw a
    robot twice knows where it is, and maps may look alike. A match counts before a single
    sighting; of sightings alone those count that most agree with.
    """
    said: dict[tuple[str, str, str], list[MapConstraint]] = {}
    for one in constraints:
        a, b = one.target, one.source
        said.setdefault((a, b, one.author) if a < b else (b, a, one.author), []).append(one)
    voices: list[MapConstraint] = []
    wrong: list[Dropped] = []
    for _, of_one in sorted(said.items(), key=lambda item: item[0]):
        voice, left_out = _voice(of_one)
        voices.append(voice)
        wrong += left_out
    return voices, wrong


def _voice(said: Sequence[MapConstraint]) -> tuple[MapConstraint, list[Dropped]]:
    """Merge what one author says of one pair."""
    if len(said) == 1:
        return said[0], []
    alike = sorted((one if one.target < one.source else turned(one) for one in said),
                   key=lambda one: (one.kind, one.T_target_source))
    agree = _agree(alike)
    seen = agree & np.array([one.kind == 'sighting' for one in alike])
    first = max(range(len(alike)), key=lambda k: (
        _rank(alike[k].kind, int(seen[k].sum())), agree[k].sum()))
    leader = alike[first]
    return (_merged(leader, [one for one, agrees in zip(alike, agree[first]) if agrees]),
            [Dropped(one, f'{one.target} - {one.source} ({one.kind}) contradicts what '
                     f'{one.author or "the same source"} says otherwise ({leader.kind})')
             for one, agrees in zip(alike, agree[first]) if not agrees])


def _rank(kind: str, seen: int) -> int:
    """Rank a kind of word, with which so many sightings agree."""
    if kind == 'sighting':
        return 2 if seen >= TWICE else 0
    return 1 if kind == 'match' else 3


def _agree(alike: Sequence[MapConstraint]) -> NDArray[np.bool_]:
    """
    Return which constraints (N,) on one pair agree with which others, (N, N).

    They do where noise, and the drift of the two maps, explain how they differ.
    """
    poses = np.array([one.T_target_source for one in alike])
    off = poses[None] - poses[:, None]
    off[..., 2] = wrap(off[..., 2])
    P = np.array([one.covariance for one in alike])
    drifting = np.array([with_drift(one.T_target_source, one.covariance) for one in alike])
    weighed = np.linalg.solve(drifting[:, None] + P[None], off[..., None])[..., 0]
    chi2 = np.einsum('nmi,nmi->nm', off, weighed)
    return np.asarray(chi2 <= chdtri(3, 1.0 - TUNING.contradiction), bool)


def _merged(leader: MapConstraint, agreeing: Sequence[MapConstraint]) -> MapConstraint:
    """Merge what agrees with a leader: constraints of one kind hang together and count as one."""
    kinds = [one.kind for one in agreeing]
    weights = [information_of(one.covariance) / kinds.count(one.kind) for one in agreeing]
    off = np.array([np.subtract(one.T_target_source, leader.T_target_source)
                    for one in agreeing])
    off[:, 2] = wrap(off[:, 2])
    P = information_of(np.sum(weights, axis=0))
    mean = np.add(leader.T_target_source, P @ np.einsum('nij,nj->i', np.array(weights), off))
    return replace(leader, T_target_source=Pose.from_array(mean), covariance=(P + P.T) / 2.0,
                   probability=max(one.probability for one in agreeing),
                   kind=next((kind for kind in kinds if kind != 'sighting'), leader.kind))
