# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a liar says of views and bonds: absurd facts, too many, a path that is not its own."""

from collections.abc import Mapping

import numpy as np
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.bond_codec import encode_bonds, ToldBond
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_facts import CONSTRAINT, Facts, SCAN, VIEW
from somfusion_ros.team.view_store import decode_batch, encode_batch
from somfusion_ros.team.view_store import LOOP as A_LOOP
from somfusion_ros.team.view_store import SCAN as A_SCAN
from somfusion_ros.team.view_store import VIEW as A_VIEW

TELLING = '11a7'
SURE = (1e-9, 0.0, 0.0, 1e-9, 0.0, 1e-9)     # upper triangle of a covariance
FLOOD = 1500       # facts of one kind
REACH = 10         # views from the first one that a liar's matches join


def absurd_batches(epoch: Epoch, rng: np.random.Generator) -> list[bytes]:
    """Make batches of facts that are none, or too many."""
    far, nan = float(rng.choice([1e9, -3e38])), float('nan')
    views = (VIEW.pack(0, 1.0, far, 0.0, 0.0), VIEW.pack(0, nan, 0.0, 0.0, 0.0),
             VIEW.pack(2 ** 32 - 1, 0.0, 0.0, 0.0, 0.0),
             VIEW.pack(3, 1.0, 0.0, 0.0, 0.0) + CONSTRAINT.pack(3, 3, 0.0, 0.0, 0.0, *SURE),
             VIEW.pack(0, 1.0, 0.0, 0.0, 0.0) + rng.integers(0, 256, 80, np.uint8).tobytes())
    loops = (CONSTRAINT.pack(1, 0, nan, 0.0, 0.0, *SURE), CONSTRAINT.pack(1, 0, *[0.0] * 9),
             CONSTRAINT.pack(7, 7, *[1.0] * 9), CONSTRAINT.pack(2, 1, 0, 0, 0, 1, 9, 9, 1, 9, 1))
    many = tuple(CONSTRAINT.pack(1, 0, *rng.normal(size=3), *SURE) for _ in range(FLOOD))
    scans = tuple(SCAN.pack(0, float(k), 0.0, 0.0, 0.0) for k in range(FLOOD))
    noise = rng.integers(0, 256, int(rng.integers(0, 200)), np.uint8).tobytes()
    return [noise, encode_batch(epoch, TELLING, Facts(views, loops, ())),
            encode_batch(epoch, TELLING, Facts((), many, scans)),
            encode_batch(epoch, TELLING, Facts())[:-3]]


def stolen(batch: bytes, epoch: Epoch) -> bytes:
    """Tell another robot's facts as if they were of the liar's own map."""
    _, _, facts = decode_batch(batch)
    return encode_batch(epoch, TELLING, Facts(*(
        tuple(fact for kind, fact in facts if kind == wanted)
        for wanted in (A_VIEW, A_LOOP, A_SCAN))))


def bonds_with(liar: str, own: Epoch, others: Mapping[str, Epoch], rng: np.random.Generator,
               times: int = 1) -> bytes:
    """Say of every robot, so many times, surely and wrongly, where its first views lie."""
    bonds = [ToldBond(liar, robot, (own, epoch), tuple(
        InterMatch(liar, int(i), robot, int(j), rng.uniform((-9, -9, -3), (9, 9, 3)),
                   1e-8 * np.eye(3)) for i, j in rng.integers(0, REACH, (200, 2))))
             for robot, epoch in sorted(others.items()) if liar < robot for _ in range(times)]
    return encode_bonds(bonds)
