# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Distinct places along a direction: what keeps two maps from sliding along it.

Two walls of a corner fix a pose, and so do twenty doors; but two walls meet two other walls by
chance. So evidence is counted along a direction by the places at which walls stand across it, not
by their length, and in several directions, of which the least counts. The direction with the least
length of wall across is not enough: in a corner of two equal walls any direction is that, and
along a slanting one each of the walls would look like many places.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PlaceSettings:
    """Numbers that the count of distinct places was tuned with."""

    directions: int = tuned(
        8, 'directions', 'of half a turn are looked along, from that of the matched walls: even, '
        'so that both directions of walls at right angles are among them', 'by design')
    place: float = tuned(
        0.8, 'm', 'evidence that one place can give at most: two end walls may meet by chance, '
        'many doors do not', 'benchmarks/fusion/calibration.py: corridors')
    movable: float = tuned(
        0.1, 'share', 'that short pieces count where they contradict: they may be furniture',
        'doc/verdict.md: pairs_floors')


PLACES = PlaceSettings()


def directions(fourfold: NDArray[np.complex128]) -> Array:
    """
    Return the axes (B, N, 2) to look along, of which one runs along the walls.

    Parameters
    ----------
    fourfold : (B,) sum over the matched walls of their length times exp(4 i angle)
    """
    steps = np.pi / PLACES.directions * np.arange(PLACES.directions)
    angle = np.angle(fourfold)[:, None] / 4.0 + steps
    return np.stack([np.cos(angle), np.sin(angle)], axis=2)


def along(axes: Array, clusters: Clusters, on: Mask, off: Mask, structure: Array) -> Array:
    """
    Count what speaks for and against hypotheses along axes (B, N, 2) of the clusters' frame [m].

    Walls across an axis fix the place along it. What lies within one metre along the axis is one
    place, and counts up to `place`. Against counts wall that runs any way: where one map shows a
    door or a crossing, it is the wall along the corridor that closes it in the other.

    Parameters
    ----------
    on, off : (B, K) whether a cluster lies on the same wall, or where the other map is free
    structure : (K,) how much each cluster is part of a straight wall

    Returns
    -------
    (2, B, N) evidence for, and against
    """
    row, one = np.nonzero(on | off)
    chosen, count = axes[row], axes.shape[1]
    across = np.einsum('mnj,mj->mn', chosen, clusters.normals[one]) ** 2
    place = np.floor(np.einsum('mnj,mj->mn', chosen, clusters.centres[one])).astype(np.intp)
    place -= place.min(initial=0)
    most = int(place.max(initial=0)) + 1
    flat = ((row[:, None] * count + np.arange(count)) * most + place).ravel()
    weight = (clusters.weights * clusters.straight)[one]
    firm = weight * (PLACES.movable + (1.0 - PLACES.movable) * structure[one])
    both = (across * (weight * on[row, one])[:, None],
            np.broadcast_to((firm * off[row, one])[:, None], across.shape))
    sums = [np.bincount(flat, part.ravel(), len(axes) * count * most) for part in both]
    shares = np.reshape(sums, (2, len(axes), count, most))
    return np.asarray(np.minimum(shares, PLACES.place).sum(3))


def place_score(held: Array, lost: Array) -> Array:
    """Return the share of the evidence that speaks for a pose, times the root of its length."""
    return np.asarray(held / (held + lost + 0.5) * np.sqrt(held))
