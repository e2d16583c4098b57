# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pair of maps with all that its figures show."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.report.pictures import Picture

if TYPE_CHECKING:
    from somfusion_ros.fusion.alignment import Trace


@dataclass(frozen=True, eq=False)
class PairData:
    """
    One pair of maps with its trace, and each robot's trajectory (N, 3) in its own map.

    The trajectories are empty where saved maps were merged, which have none.
    """

    target: str
    source: str
    grids: tuple[Grid, Grid]
    trace: 'Trace'
    paths: tuple[Array, Array]
    _pictures: dict[str, Picture] = field(default_factory=dict)

    def picture(self, name: str, make: Callable[[], Picture]) -> Picture:
        """Return a picture, made at the first call: the page and the single figures share it."""
        if name not in self._pictures:
            self._pictures[name] = make()
        return self._pictures[name]

    @property
    def pose(self) -> Pose | None:
        """T_target_source, the best found, accepted or not."""
        return self.trace.alignment.T_target_source

    @property
    def runner_up(self) -> Pose | None:
        """T_target_source of the best rival, if there is one."""
        rival = self.trace.alignment.runner_up
        return None if rival is None else rival.T_target_source
