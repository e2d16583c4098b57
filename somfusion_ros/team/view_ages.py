# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How old views are when the global map shows them first."""

from collections.abc import Mapping

from somfusion_ros.team.heard import Heard
from somfusion_ros.team.view_set import ViewSet


class ViewAges:
    """Notes for every robot that was heard how old its views are when they are drawn."""

    def __init__(self, heard: Mapping[str, Heard]) -> None:
        self._heard = heard
        self._drawn: dict[str, tuple[float, int]] = {}     # stamp of the first view, and how many

    def note(self, drawn: Mapping[str, ViewSet], now: float) -> None:
        """Note the views that the newest global map shows, at a time [s] of their clock."""
        for robot, views in drawn.items():
            first, before = self._drawn.get(robot, (-1.0, 0))
            heard = self._heard.get(robot)
            if heard is not None and first == views.stamps[0]:
                heard.view_ages.extend((now - views.stamps[before:]).tolist())
            self._drawn[robot] = float(views.stamps[0]), len(views)     # those of before are old
