# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints in a file while the SLAM runs, and the last one of them after a restart."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import ref

from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_file import CheckpointFile
from somfusion_ros.slam.slam import Slam
from somfusion_ros.whole_files import open_file, Opener


class CheckpointKeeper:
    """
    One checkpoint file; an empty path keeps nothing. Times are of a steady clock [s].

    Raises OSError, with a sentence, where the path is a directory or another process has the
    file.
    """

    def __init__(self, path: str, interval: float, count: Callable[..., None],
                 say: Callable[[str], Any], opened: Opener = open_file) -> None:
        self._file = CheckpointFile(Path(path), opened) if path else None
        self._interval, self._count, self._say = interval, count, say
        self._lock = Lock()           # of the file: a reset waits for a write, and is not undone
        self._due = 0.0
        self._kept: Any = None
        self._holds = False           # the file, what this run goes on from or kept
        self._forgotten: Callable[[], Slam | None] = lambda: None
        self.fault = ''               # why the last checkpoint could not be kept, '' if it was

    def load(self) -> Checkpoint | None:
        """Return the checkpoint to go on from; count a damaged file and put it aside."""
        if self._file is None:
            return None
        path = self._file.path
        try:
            checkpoint, flaws = self._file.load()
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self._count('state_unusable', f'{error}; a new map begins')
            self._put_aside(path)
            return None
        self._holds = checkpoint.closed and self._mark(False)
        checkpoint = replace(checkpoint, closed=self._holds)   # a crash would not be noticed else
        flaws.count(path, self._count)
        self._say(f'goes on from {len(checkpoint.poses)} views of {path}')
        return checkpoint

    def keep(self, slam: Slam, step: Any, now: float) -> None:
        """Save if it is time to, and if anything happened: step is the newest."""
        if self._file is None or step is None or step is self._kept or now < self._due:
            return
        with self._lock:
            if slam is self._forgotten():
                return
            try:
                checkpoint = slam.checkpoint()
                if len(checkpoint.poses):
                    self._file.save(checkpoint)
                    self._holds = True
                self._kept, self.fault = step, ''
            except OSError as error:
                self.fault = str(error)
                self._count('state_not_saved', self.fault)
        self._due = now + self._interval

    def forget(self, slam: Slam | None = None) -> None:
        """Delete the file; what this SLAM still has to keep is not kept any more."""
        with self._lock:
            if slam is not None:
                self._forgotten = ref(slam)
            if self._file is not None:
                self._file.delete()
            self._kept, self._holds = None, False

    def shut(self, step: Any) -> None:
        """Note, as the program ends, that nothing was told after what is kept, if step is that."""
        with self._lock:
            if self._holds and step is self._kept and not self.fault:
                self._mark(True)

    def _mark(self, closed: bool) -> bool:
        """Note whether the file has all that was told; return whether that could be noted."""
        assert self._file is not None
        try:
            self._file.mark(closed)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Let another process have the file."""
        if self._file is not None:
            self._file.close()

    def _put_aside(self, path: Path) -> None:
        """Keep a file that cannot be used under another name."""
        try:
            if path.is_file():
                path.replace(path.with_name(f'{path.name}.bad'))
        except OSError as error:
            self._count('state_unusable', str(error))
