# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a replay goes on from: a checkpoint of an earlier run, or a map to localise in."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from somfusion_ros.grid import Grid
from somfusion_ros.io.errors import InputError
from somfusion_ros.io.maps import read_map, YAMLS
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_file import load_checkpoint
from somfusion_ros.slam.grid_views import grid_checkpoint
from somfusion_ros.slam.start import Start


@dataclass(frozen=True, eq=False)
class Beginning:
    """
    A map to start in, None for a new one, and how.

    flaws: what of its file had to be left out, by kind, each with a sentence.
    """

    checkpoint: Checkpoint | None = None
    start: Start = field(default_factory=Start)
    flaws: Mapping[str, str] = field(default_factory=dict)

    def counted(self, count: Callable[[str, str], object]) -> 'Beginning':
        """Count what had to be left out; return this beginning."""
        for kind, reason in self.flaws.items():
            count(kind, reason)
        return self


def from_state(path: str | Path) -> Beginning:
    """Return how to go on from a state file, wherever the robot is; a new map if there is none."""
    try:
        return _load(path, Start(anywhere=True))
    except FileNotFoundError:
        return Beginning()


def from_map(path: str | Path) -> Beginning:
    """
    Return how to localise in a map: map.yaml as map_server has it, or a state file.

    Raises InputError, with one line, where it cannot be used.
    """
    try:
        if Path(path).suffix.lower() not in YAMLS:
            return _load(path, Start(anywhere=True, localization=True))
    except FileNotFoundError:
        raise InputError(f'{path} does not exist') from None
    try:
        return from_grid(read_map(path))
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f'{path}: {error}') from error


def from_grid(grid: Grid) -> Beginning:
    """Return how to localise in a drawn map; ValueError where it cannot be used."""
    return Beginning(grid_checkpoint(grid), Start(anywhere=True, localization=True, drawn=grid))


def _load(path: str | Path, start: Start) -> Beginning:
    """Read a state file; OSError where it cannot be read, InputError where it holds no state."""
    flaws: dict[str, str] = {}
    try:
        return Beginning(load_checkpoint(path, flaws.__setitem__), start, flaws)
    except ValueError as error:
        raise InputError(str(error)) from error
