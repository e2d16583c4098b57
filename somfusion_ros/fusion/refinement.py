# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sub-cell refinement of a hypothesis, with its covariance.

Clusters average the cells of a piece of wall and so lie on it to a fraction of a cell. Both maps'
clusters are pulled onto the lines through the other's, point to line, both ways, so that neither
map is preferred; a robust weight keeps what has moved or bent from pulling.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.fusion.cluster_matching import match
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import Array, inverse, place, rotation
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class RefinementSettings:
    """Numbers that the refinement was tuned with."""

    reaches: tuple[float, ...] = tuned(
        (0.3, 0.2, 0.15, 0.15), 'm',
        'furthest match in each step',
        'benchmarks/fusion/stages.py: strict')
    rough: int = tuned(
        2, 'steps',
        'the first, for which a sketch of a map is enough',
        'benchmarks/fusion/stages.py: strict')
    angle: float = tuned(
        15.0, 'deg',
        'most between the normals of a match',
        'by design')
    half_pull: float = tuned(
        0.05, 'm',
        'distance at which a match has lost half of its pull: a cell',
        'benchmarks/fusion/stages.py: strict')
    shared: float = tuned(
        4.0, 'clusters',
        'next to one another err alike and count as one measurement',
        'benchmarks/fusion/calibration.py')


REFINEMENT = RefinementSettings()


def refine(pose: Array, target: LearnedMap, source: LearnedMap) -> tuple[Array, Array]:
    """
    Refine T_target_source (3,); return it with its covariance (3, 3) [m, m, rad].

    Directions that no wall fixes keep a large variance.
    """
    pose = np.array(pose, dtype=float)
    for step, reach in enumerate(REFINEMENT.reaches):
        few = step < REFINEMENT.rough
        J, off, weight = _residuals(pose, target, source, reach, few)
        pull = weight / (1.0 + (off / REFINEMENT.half_pull) ** 2)
        H = (J * pull[:, None]).T @ J + np.diag([0.05, 0.05, 0.2])
        move = np.linalg.solve(H, (J * pull[:, None]).T @ off)
        pose = pose + move
    off = off - J @ move     # what the last step left; it is too short to match anew
    pull = (weight > 0) / (1.0 + (off / REFINEMENT.half_pull) ** 2)
    noise = max(float((pull * off ** 2).sum() / max(pull.sum(), 1.0)),
                target.resolution ** 2 / 12.0)
    H = (J * pull[:, None]).T @ J / (noise * REFINEMENT.shared) + np.diag([1.0, 1.0, 10.0]) * 0.1
    return pose, np.linalg.inv(H)


def widen(covariance: Array, pose: Array, source: LearnedMap, warp: Warp) -> Array:
    """
    Add to a covariance (3, 3) what one rigid pose leaves wrong where the maps are bent.

    The displacements of the warp spread over the overlap: as an error of the place in its middle,
    and of the turn about it.
    """
    at = place(pose[None], source.sketch.centres)
    moves = warp.at(at)[:, 0].T.astype(float)
    middle = at[:, 0].mean(1)
    reach = max(float(((at[:, 0].T - middle) ** 2).sum(1).mean()), 1.0)
    spread = np.zeros((3, 3))
    spread[:2, :2] = moves.T @ moves / len(moves)
    spread[2, 2] = float((moves ** 2).sum(1).mean()) / reach
    arm = pose[:2] - middle
    J = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]], [0.0, 0.0, 1.0]])
    return np.asarray(covariance + J @ spread @ J.T)


def _residuals(pose: Array, target: LearnedMap, source: LearnedMap, reach: float,
               few: bool = False) -> tuple[Array, Array, Array]:
    """Return Jacobian (M, 3) in (x, y, theta) of the pose, moves (M,) and weights (M,)."""
    rows = []
    R = rotation(pose[2])
    for seen, by, forth in ((source, target, True), (target, source, False)):
        way = pose if forth else inverse(pose)
        clusters = seen.sketch if few else seen.features
        found = match(way[None], clusters, by.features, by.nearest,
                      np.radians(REFINEMENT.angle), 0.5)
        off, line = found.off[0].astype(float), found.normals[:, 0].astype(float)
        # The line of the other map, brought to the target's frame, and the point that turns.
        normal = line if forth else -R @ line
        arm = R @ (clusters.centres.T if forth else found.at[:, 0])
        J = np.column_stack([normal[0], normal[1], arm[0] * normal[1] - arm[1] * normal[0]])
        weight = found.agrees[0] * (np.abs(off) < reach) * np.minimum(
            clusters.weights * clusters.straight,
            (by.features.weights * by.features.straight)[found.other[0]])
        rows.append((J, off, weight))
    J, off, weight = (np.concatenate(part) for part in zip(*rows, strict=True))
    return J, off, weight
