# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints in a file while the SLAM runs, and the last one of them after a restart."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_file import load_checkpoint, save_checkpoint
from somfusion_ros.slam.slam import Slam


class CheckpointKeeper:
    """One checkpoint file; an empty path keeps nothing. Times are of a steady clock [s]."""

    def __init__(self, path: str, interval: float, count: Callable[..., None],
                 say: Callable[[str], Any]) -> None:
        self._path = Path(path).expanduser() if path else None
        self._interval, self._count, self._say = interval, count, say
        self._due = 0.0
        self._kept: Any = None

    def load(self) -> Checkpoint | None:
        """Return the checkpoint to go on from; count a damaged file and put it aside."""
        if self._path is None:
            return None
        try:
            checkpoint = load_checkpoint(self._path)
            self._say(f'goes on from {len(checkpoint.poses)} views of {self._path}')
            return checkpoint
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self._count('state_unusable', f'{error}; a new map begins')
        try:
            self._path.replace(self._path.with_name(f'{self._path.name}.bad'))
        except OSError as error:
            self._count('state_unusable', str(error))
        return None

    def keep(self, slam: Slam, step: Any, now: float) -> None:
        """Save if it is time to, and if anything happened: step is the newest."""
        if self._path is None or step is None or step is self._kept or now < self._due:
            return
        try:
            checkpoint = slam.checkpoint()
            if len(checkpoint.poses):
                save_checkpoint(self._path, checkpoint)
            self._kept = step
        except OSError as error:
            self._count('state_not_saved', str(error))
        self._due = now + self._interval

    def forget(self) -> None:
        """Delete the file, so that no later run goes on from here."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
        self._kept = None
