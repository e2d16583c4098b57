# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a liar says of views and bonds: absurd facts, too many, a path that is not its own."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.team.bond_codec import encode_bonds, ToldBond
from somfusion_ros.team.fact import LOOP, SCAN, TAKEN_BACK, VIEW
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_facts import (encode_constraint, encode_scan, Facts, MAX_VIEWS,
                                           ViewFact)
from somfusion_ros.team.view_set import DrawnScan
from somfusion_ros.team.view_store import decode_batch, encode_batches

TELLING = '11a7'
SURE = 1e-8 * np.eye(3)
FLOOD = 1500       # facts of one kind
FEW = 60           # matches of a bond
REACH = 10         # views from the first one that a liar's matches join
NOTHING = Outline(np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), np.zeros(2))


@cache
def flood() -> Facts:
    """Make far more loops and scans than so few views can have."""
    loops = (encode_constraint(Constraint(0, 1, np.array([0.01 * k, 0.0, 0.0]), SURE))
             for k in range(FLOOD))
    scans = (encode_scan(DrawnScan(float(k), 0, np.zeros(3), NOTHING)) for k in range(FLOOD))
    return Facts((), tuple(loops), tuple(scans))


def absurd_batches(epoch: Epoch, rng: np.random.Generator) -> list[bytes]:
    """Make batches of facts that are none, or too many."""
    words = rng.integers(0, 1 << 16, (40, 2), np.uint16)
    outline, beams = words.tobytes(), [180, 0, 0, 0, 10 ** 5, 0, 0]
    views = tuple(ViewFact(number, 1.0, np.array([x, 0.0, 0.0]), step, beams, outline).encode()
                  for number, x, step in (
        (0, 9e6, None), (MAX_VIEWS + 1, 0.0, None), (0, 0.0, None),
        (3, 0.0, Constraint(3, 3, np.zeros(3), SURE))))
    loops = (encode_constraint(Constraint(7, 7, np.ones(3), SURE)),
             encode_constraint(Constraint(0, 1, np.array([9e6, 0.0, 0.0]), SURE)))
    noise = rng.integers(0, 256, int(rng.integers(0, 200)), np.uint8).tobytes()
    return [noise, *_batches(epoch, Facts(views, loops)), *_batches(epoch, flood()),
            *(batch[:-3] for batch in _batches(epoch, Facts((), loops)))]


def _batches(epoch: Epoch, facts: Facts) -> list[bytes]:
    """Pack facts as the liar's."""
    return encode_batches(epoch, TELLING, facts)


def stolen(batch: bytes, epoch: Epoch) -> bytes:
    """Tell another robot's facts as if they were of the liar's own map."""
    _, _, facts = decode_batch(batch)
    told, = _batches(epoch, Facts(*(tuple(fact for fact in facts if fact.kind == kind)
                                    for kind in (VIEW, LOOP, SCAN, TAKEN_BACK))))
    return told


def bonds_with(liar: str, own: Epoch, others: Mapping[str, Epoch], rng: np.random.Generator,
               times: int = 1) -> bytes:
    """Say of every robot, so many times, surely and wrongly, where its first views lie."""
    bonds = [ToldBond(liar, robot, (own, epoch), tuple(
        InterMatch(liar, int(i), robot, int(j), rng.uniform((-9, -9, -3), (9, 9, 3)),
                   SURE) for i, j in rng.integers(0, REACH, (FEW, 2))))
             for robot, epoch in sorted(others.items()) if liar < robot for _ in range(times)]
    return encode_bonds(bonds)
