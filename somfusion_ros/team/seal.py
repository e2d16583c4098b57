# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A robot's signature under what it said of its map, by which others tell its newest word.

While a robot is there it speaks for itself. Once it is gone, others say what it said last, and
not all of them heard the same. What is sealed by the key that they know it by is its own, however
few say it; of two such words the one with the higher number is newer.
"""

from collections import Counter
from collections.abc import Iterable
from hashlib import sha256
import json
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.ed25519 import KEY, public_key, sign, SIGNATURE, verify

UPPER = np.triu_indices(3)
MOST_CHECKS = 6     # seals of what others say that are checked in one piece of work
KEPT_CHECKS = 256   # of which is remembered how they came out


class Seal(NamedTuple):
    """Public key (32 bytes) of who said it, the number of what it said, signature (64 bytes)."""

    key: bytes
    number: int
    signature: bytes

    def empty(self) -> 'Seal':
        """Return the seal, under nothing, of one that says with this key what it does not seal."""
        return Seal(self.key, -1, b'')


class Sealer:
    """Seals what one robot says with a secret key (32 bytes); what it says again, alike."""

    def __init__(self, robot: str, secret: bytes) -> None:
        self._robot, self._secret, self._number = robot, secret, 0
        self._said: Any = None
        self._seal: Seal | None = None

    def seal(self, epoch: Epoch | None, constraints: Iterable[MapConstraint]) -> Seal | None:
        """Return the seal of what the robot accepts about its map; None while it has none."""
        if epoch is None:
            return None
        said = str(epoch), _written(constraints)
        if said != self._said:
            self._said, self._number = said, self._number + 1
            message = _message(self._robot, self._number, *said)
            self._seal = Seal(public_key(self._secret), self._number, sign(self._secret, message))
        return self._seal


class SealChecks:
    """
    Checks whose words are sealed by whom, each once.

    Of what others say only few are checked in one piece of work, and the same number of each.
    """

    def __init__(self) -> None:
        self._checked: dict[tuple[Seal, bytes], bool] = {}
        self._asked: Counter[str] = Counter()

    def begin(self) -> None:
        """Begin another piece of work."""
        self._asked.clear()

    def hold(self, seal: Seal, robot: str, epoch: Epoch, constraints: Iterable[MapConstraint],
             owner: str = '') -> bool | None:
        """
        Return whether a seal is that of what a robot is said to have said.

        owner: the peer that says so, if any; None where that is not known yet.
        """
        message = _message(robot, seal.number, str(epoch), _written(constraints))
        key = seal, sha256(message).digest()
        if key not in self._checked:
            if owner and (self._asked[owner] or self._asked.total() >= MOST_CHECKS):
                return None
            self._asked[owner] += bool(owner)
            while len(self._checked) >= KEPT_CHECKS:
                del self._checked[next(iter(self._checked))]
            self._checked[key] = verify(seal.key, message, seal.signature)
        return self._checked[key]


def encode_seal(seal: Seal | None) -> list[Any] | None:
    """Write a seal for JSON."""
    if seal is None or not seal.signature:
        return None
    return [seal.key.hex(), seal.number, seal.signature.hex()]


def decode_seal(record: Any) -> Seal | None:
    """Read a seal; ValueError or TypeError where it is none."""
    if record is None:
        return None
    key, number, signature = record
    seal = Seal(bytes.fromhex(key), number, bytes.fromhex(signature))
    if type(number) is not int or not 0 <= number < 1 << 62 or (
            len(seal.key), len(seal.signature)) != (KEY, SIGNATURE):
        raise ValueError('a seal is none')
    return seal


def record_of(constraint: MapConstraint) -> dict[str, Any]:
    """Write one constraint for JSON; numbers keep every digit."""
    return {'target': constraint.target, 'source': constraint.source, 'kind': constraint.kind,
            'epochs': [str(epoch) for epoch in constraint.epochs],
            'pose': [float(number) for number in constraint.T_target_source],
            'probability': float(constraint.probability),
            'covariance': constraint.covariance[UPPER].astype(float).tolist()}


def _written(constraints: Iterable[MapConstraint]) -> tuple[str, ...]:
    """Write constraints in an order of their own."""
    return tuple(sorted(json.dumps(record_of(one), sort_keys=True) for one in constraints))


def _message(robot: str, number: int, epoch: str, written: tuple[str, ...]) -> bytes:
    """Return what is signed."""
    return json.dumps([robot, number, epoch, *written]).encode()
