# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The global map of a fusion node: drawn where it changed, repeated where it did not, saved."""

from collections.abc import Callable
from pathlib import Path
import time

from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import write_map
from somfusion_ros.node_config import FusionNodeConfig
from somfusion_ros.ros.fusion.publisher import FusionPublisher
from somfusion_ros.team.session import FusionSession

DRAWING_SHARE = 4.0   # at most one part in so many of the time goes into drawing


class GlobalMap:
    """Draws in the thread that works; config holds the rates."""

    def __init__(self, session: FusionSession, publisher: FusionPublisher,
                 config: FusionNodeConfig, count: Callable[..., None],
                 drawn: Callable[[], object] = lambda: None) -> None:
        self._session, self._publisher, self._count = session, publisher, count
        self._drawn = drawn      # what is to be done once a map is out
        self.config = config
        self._grid: Grid | None = None
        self._draw_due = self._repeat_due = 0.0

    def update(self, force: bool = False) -> None:
        """Draw the map where it changed, else repeat it, not more often than is good."""
        start = time.monotonic()
        if start < self._draw_due and not force:
            return
        try:
            grid = self._session.draw()
        except ValueError as error:
            self._count('global_map_impossible', str(error))
            return
        if grid is not None:
            self._grid = grid
            self._publisher.global_map(grid)
            self._drawn()
            took = time.monotonic() - start
            self._draw_due = start + max(1.0 / self.config.merging_rate, DRAWING_SHARE * took)
        elif start >= self._repeat_due:
            self._publisher.repeat_global_map()
        else:
            return
        self._repeat_due = time.monotonic() + self.config.map_update_interval

    def save(self, stem: Path) -> str:
        """Write `<stem>.yaml` and `<stem>.pgm`; return what was done."""
        if self._grid is None:
            raise ValueError("there is no global map to save yet: the robot's own map has not "
                             'come')
        return f'map saved to {write_map(stem.parent, self._grid, stem.name)}'
