# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Checkpoints of one robot's SLAM in a journal: a robot goes on with its map after a restart.

What did not change since the last checkpoint is not written again. Where a record is damaged, its
view loses its surface, or its constraint is made of the poses; the map stays.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_reader import assemble, CLOSED, Flaws, OPENED
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.journal import Journal, packed
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.whole_files import open_file, Opener

WASTE = 2        # the file is written anew once it is so many times as long as what it holds
LEAST = 1 << 22  # [bytes] below which it is not


class CheckpointFile:
    """A file that this process keeps its checkpoints in; raises JournalInUse, OSError."""

    def __init__(self, path: str | Path, opened: Opener = open_file) -> None:
        self.path = Path(path).expanduser()
        if self.path.is_dir():
            raise IsADirectoryError(f'{self.path} is a directory')
        self._journal = Journal(self.path, opened)
        self._whole = 0                # length [bytes] of the file when it was written anew
        self._forget()

    def load(self) -> tuple[Checkpoint, Flaws]:
        """
        Return the newest checkpoint, and what of the file was left out.

        FileNotFoundError where there is no file; ValueError, naming it, where nothing in it can
        be used.
        """
        return _read(self.path)

    def save(self, checkpoint: Checkpoint) -> int:
        """Write what changed and return its length [bytes]; OSError where the disk is full."""
        if (self._whole and self._is_copied_by(checkpoint)
                and self._journal.size <= max(LEAST, WASTE * self._whole)):
            data = b''.join(self._changes(checkpoint))
            self._journal.append(data)
        else:
            self._forget()
            data = b''.join(self._changes(checkpoint))
            self._journal.replace(data)
            self._whole = len(data)
        self._remember(checkpoint)
        return len(data)

    def mark(self, closed: bool) -> None:
        """Note whether nothing, or maybe more, was told of the map after the newest checkpoint."""
        self._journal.append(packed(CLOSED if closed else OPENED, {}))

    def delete(self) -> None:
        """Delete the file, so that no later run goes on from it."""
        self._journal.delete()
        self._forget()

    def close(self) -> None:
        """Let another process have the file."""
        self._journal.close()

    def _forget(self) -> None:
        """Hold nothing as written."""
        self._whole = 0
        self._stamps = np.zeros(0)                  # [s] of the views
        self._constraints: Sequence[Constraint] = ()
        self._epoch = Epoch()
        self._trail = 0
        self._void: set[int] = set()    # views without a surface
        self._trail_end = np.inf        # stamp [s] of the trail's last row
        self._scans: dict[MapScan, int] = {}
        self._next_scan = 0

    def _is_copied_by(self, checkpoint: Checkpoint) -> bool:
        """Return whether a checkpoint is a later one of the map that is written."""
        views, constraints = len(self._stamps), self._constraints
        return (checkpoint.epoch == self._epoch
                and np.array_equal(checkpoint.stamps[:views], self._stamps)
                and all(new is old for new, old in zip(
                    checkpoint.constraints, constraints, strict=False))
                and len(checkpoint.constraints) >= len(constraints))

    def _remember(self, checkpoint: Checkpoint) -> None:
        """Hold a checkpoint as written."""
        self._stamps, self._constraints = checkpoint.stamps, checkpoint.constraints
        self._epoch, self._trail = checkpoint.epoch, len(checkpoint.trail)
        self._void = {k for k, cloud in enumerate(checkpoint.clouds) if not len(cloud)}
        self._trail_end = float(checkpoint.trail[-1, 0]) if self._trail else np.inf
        for scan in checkpoint.scans:
            if scan not in self._scans:
                self._scans[scan] = self._next_scan
                self._next_scan += 1
        kept = set(checkpoint.scans)
        self._scans = {scan: n for scan, n in self._scans.items() if scan in kept}

    def _changes(self, c: Checkpoint) -> list[bytes]:
        """Return the records that take what is written to a checkpoint."""
        views = range(len(self._stamps), len(c.clouds))
        void = [k for k in range(views.start) if not len(c.clouds[k]) and k not in self._void]
        made = [_view(k, c.stamps[k], c.clouds[k]) for k in (*void, *views)]
        made += [_constraint(k, c.constraints[k])
                 for k in range(len(self._constraints), len(c.constraints))]
        new = [scan for scan in c.scans if scan not in self._scans]
        made += [_map_scan(self._next_scan + k, scan) for k, scan in enumerate(new)]
        kept = set(c.scans)
        gone = [n for scan, n in self._scans.items() if scan not in kept]
        if gone:
            made.append(packed('drop', {'numbers': np.array(gone)}))
        made += self._trail_changes(c.trail)
        state = {'poses': c.poses, 'view': np.array(c.view),
                 'to_close': np.array(c.to_close, int),
                 'around': np.array(c.around, int), 'fresh': np.array(c.fresh, int),
                 'epoch': np.frombuffer(str(c.epoch).encode(), np.uint8)}
        return [*made, packed('now', {**state, **c.tracker.arrays()})]

    def _trail_changes(self, trail: Array) -> list[bytes]:
        """Return the record of the trail's new rows, of all where it was thinned."""
        n = self._trail
        grown = n and len(trail) >= n and trail[n - 1, 0] == self._trail_end
        first = n if grown else 0
        return [packed('path', {'first': np.array(first), 'rows': trail[first:]})]


def save_checkpoint(path: str | Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint to a file of its own."""
    file = CheckpointFile(path)
    try:
        file.save(checkpoint)
    finally:
        file.close()


def load_checkpoint(path: str | Path,
                    count: Callable[[str, str], object] = lambda kind, reason: None) -> Checkpoint:
    """
    Read the newest checkpoint of a file; what had to be left out is counted, with its sentence.

    FileNotFoundError where there is none; ValueError, naming the file, where nothing in it can be
    used.
    """
    path = Path(path).expanduser()
    checkpoint, flaws = _read(path)
    flaws.count(path, count)
    return checkpoint


def _read(path: Path) -> tuple[Checkpoint, Flaws]:
    """Return the newest checkpoint, and what of the file was left out."""
    try:
        return assemble(path.read_bytes())
    except ValueError as error:
        raise ValueError(f'{path}: not a usable checkpoint ({error})') from error


def _view(k: int, stamp: float, cloud: Cloud) -> bytes:
    """Return the record of a view; surfaces are kept in single precision (0.01 mm)."""
    return packed('view', {'k': np.array(k), 'stamp': np.array(stamp),
                           'points': cloud.points.astype(np.float32),
                           'normals': cloud.normals.astype(np.float32),
                           'scatter': np.array([cloud.noise, cloud.spacing]),
                           **_outline(cloud.outline)})


def _constraint(k: int, constraint: Constraint) -> bytes:
    """Return the record of a constraint."""
    return packed('pair', {'k': np.array(k),
                           'views': np.array([constraint.first, constraint.second]),
                           'z': constraint.z, 'R': constraint.R})


def _map_scan(number: int, scan: MapScan) -> bytes:
    """Return the record of a scan kept for the map."""
    return packed('scan', {'n': np.array(number), 'view': np.array(scan.view),
                           'pose': scan.T_view_base, **_outline(scan.outline)})


def _outline(outline: Outline) -> dict[str, Array]:
    """Return the arrays of an outline."""
    return {'ends': outline.ends, 'reach': outline.reach,
            'hit': np.packbits(outline.hit), 'origin': outline.origin}
