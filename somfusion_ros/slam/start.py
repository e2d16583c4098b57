# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a run starts in a map that there is."""

from dataclasses import dataclass

from somfusion_ros.grid import Grid


@dataclass(frozen=True, eq=False)
class Start:
    """
    How a run starts in a map that there is.

    anywhere : the robot is sought in the whole map first; otherwise it is taken to stand where
        it stood, unless what it sees says otherwise
    localization : the robot is tracked in the map, and the map is left as it is
    drawn : the map as somebody else has drawn it, for such a run
    """

    anywhere: bool = False
    localization: bool = False
    drawn: Grid | None = None
