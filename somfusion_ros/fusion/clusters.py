# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The neurons of a map, as the stages pass them on: places, normals and how sure they are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array

Index = NDArray[np.intp]
SURE = 0.3      # sidedness from which the sign of a normal counts


@dataclass(frozen=True, eq=False, kw_only=True)
class Clusters:
    """
    K neurons of a map, in its frame, with the chain that joins them.

    centres (K, 2) [m]; weights (K,) length of wall that each stands for [m]; segments (K,) the
    segment of each; edges (E, 2) pairs of adjacent neurons; normals (K, 2) unit point normals
    towards free space, zero where unknown; straight (K,) 0..1, how well the surfaces around agree;
    sided (K,) 0..1, how sure the sign of the normal is.
    """

    centres: Array
    weights: Array
    segments: Index
    edges: Index
    normals: Array
    straight: Array
    sided: Array

    def __len__(self) -> int:
        """Count the neurons."""
        return len(self.centres)

    @cached_property
    def table(self) -> NDArray[np.float32]:
        """Centres, normals, weights and whether the normal's sign is sure, (6, K): one look-up."""
        return np.stack([*self.centres.T, *self.normals.T, self.weights,
                         self.sided > SURE]).astype(np.float32)

    def take(self, chosen: Index) -> 'Clusters':
        """Return the chosen clusters, without edges."""
        return Clusters(centres=self.centres[chosen], weights=self.weights[chosen],
                        segments=self.segments[chosen], edges=np.empty((0, 2), np.intp),
                        normals=self.normals[chosen], straight=self.straight[chosen],
                        sided=self.sided[chosen])

    @classmethod
    def none(cls) -> 'Clusters':
        """Return no neurons at all."""
        return cls(centres=np.empty((0, 2)), weights=np.empty(0), segments=np.empty(0, np.intp),
                   edges=np.empty((0, 2), np.intp), normals=np.empty((0, 2)),
                   straight=np.empty(0), sided=np.empty(0))
