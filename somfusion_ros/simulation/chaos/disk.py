# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A SLAM that is restarted from its checkpoints, of which the disk lost or spoilt a part.

The file, the writing, the reading and the SLAM that goes on from it are the real ones.
"""

from collections import Counter
from collections.abc import Callable
import errno
from functools import lru_cache
import io
from pathlib import Path
import tempfile
from typing import Any, BinaryIO, cast

import numpy as np
from somfusion_ros.simulation.chaos.tapes import cells_of, Tape
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.slam import Slam
from somfusion_ros.team.teller import tell

KINDS = ('', 'flips bits', 'tears a write', 'is full')
VARIANTS = 2       # of each kind of damage to each file: few, so that maps come again
FLIPS = 12         # bits
KEPT = 256         # restarts that are remembered: what was restarted may be so again


class _FullDisk(io.FileIO):
    """A file on a disk that takes a number of bytes more."""

    left = 0

    def write(self, data: Any) -> int:
        """Write what there is room for."""
        taken = super().write(bytes(data)[:self.left])
        self.left -= taken
        if taken < len(data):
            raise OSError(errno.ENOSPC, 'No space left on device')
        return taken


class _Kept:
    """A SLAM of which only the checkpoint is asked for."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint = lambda: checkpoint


@lru_cache(KEPT)
def restarted(tape: Tape, come: int, kind: str, variant: int) -> tuple[Tape | None, Counter[str]]:
    """
    Keep the first checkpoints of a tape on a disk that fails in a way, and restart the SLAM.

    Returns what the SLAM has then, None where it begins a new map, and what was counted.
    """
    rng = np.random.default_rng([come, KINDS.index(kind), variant])
    counts: Counter[str] = Counter()

    def count(name: str, reason: str = '') -> None:
        counts[name] += 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'robot.state'
        _keep(path, tape.kept[:come], kind, rng, count)
        if kind in ('flips bits', 'tears a write'):
            _spoil(path, kind, rng)
        keeper = CheckpointKeeper(str(path), 0.0, count, lambda text: None)
        checkpoint = keeper.load()
        keeper.close()
    if checkpoint is None:
        return None, counts
    session = Session(SlamConfig(), 0.5, count, checkpoint, background=False, start='9')
    now = session.slam.checkpoint()
    held = max(k for k in range(come) if len(tape.kept[k].poses) <= max(
        len(now.poses), len(tape.kept[0].poses)))
    pose = tape.pose_at(tape.map_times[held])
    told = tape.map_times[held] >= tape.alike_until
    return Tape(tape.place, tape.T_place_map, (0.0,), (cells_of(session.slam.grid()),),
                (tell(now),), (now,), np.zeros(1), np.array([pose]),
                alike_until=0.0 if told else np.inf), counts


def _keep(path: Path, kept: tuple[Checkpoint, ...], kind: str, rng: np.random.Generator,
          count: Callable[..., None]) -> None:
    """Write checkpoints one after another; the disk may be full from one of them on."""
    full_at = int(rng.integers(len(kept))) if kind == 'is full' else len(kept)

    def opened(path: Path, mode: str) -> BinaryIO:
        file = _FullDisk(path, mode.replace('b', ''))
        file.left = room
        return cast(BinaryIO, file)
    room = 1 << 40
    keeper = CheckpointKeeper(str(path), 0.0, count, lambda text: None, opened)
    for k, checkpoint in enumerate(kept):
        if k == full_at:
            keeper.close()
            room = int(rng.integers(1, 3000))
            keeper = CheckpointKeeper(str(path), 0.0, count, lambda text: None, opened)
        keeper.keep(cast(Slam, _Kept(checkpoint)), k, float(k))
    keeper.close()


def _spoil(path: Path, kind: str, rng: np.random.Generator) -> None:
    """Flip bits of a file, or cut its end off, as where the power failed."""
    data = bytearray(path.read_bytes())
    if kind == 'flips bits':
        for at in rng.integers(0, len(data), FLIPS):
            data[at] ^= 1 << int(rng.integers(8))
    else:
        del data[int(rng.integers(len(data) // 2, len(data))):]
    path.write_bytes(bytes(data))
