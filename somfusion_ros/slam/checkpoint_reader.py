# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints of records: the newest whole one, with what is damaged left out or made good."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.checkpoint import Checkpoint, NOTHING
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.journal import DAMAGED, records
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.record_fault import record_fault
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.tracker_state import SHAPES, TrackerState

OPENED, CLOSED = 'open', 'shut'    # kinds of records: more may be told of the map, or nothing
RECORDS = {'view': 'a view', 'pair': 'a constraint', 'scan': 'a scan', 'drop': 'dropped scans',
           'void': 'empty views', 'path': 'the trail', 'now': 'a checkpoint'}
MADE_GOOD = np.diag([0.05, 0.05, 0.02]) ** 2   # covariance of a constraint made of the poses


@dataclass
class _Read:
    """What the records up to now tell, by number; the newest is the last that is whole."""

    views: dict[int, tuple[float, Cloud]] = field(default_factory=dict)
    constraints: dict[int, Constraint] = field(default_factory=dict)
    scans: dict[int, MapScan] = field(default_factory=dict)
    trail: Array = field(default_factory=lambda: np.zeros((0, 5)))
    newest: Checkpoint | None = None
    closed: bool = False
    damaged: int = 0
    refused: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class Flaws:
    """
    What of a journal was left out.

    damaged: stretches of it with a wrong checksum; refused: records with a right one that hold
    what cannot be, by what that is.
    """

    damaged: int
    refused: Mapping[str, int]

    def count(self, path: Path, count: Callable[[str, str], object]) -> None:
        """Count each kind of flaw of a file once, with its sentence."""
        if self.damaged:
            count('state_damaged', f'{path} is damaged in {self.damaged} places, which are left '
                  'out of the map')
        if self.refused:
            what = ', '.join(f'{wrong} ({n})' for wrong, n in sorted(self.refused.items()))
            count('state_records_refused', f'{path} holds what cannot be, which is left out of '
                  f'the map, though its checksums are right: {what}')


def assemble(data: bytes) -> tuple[Checkpoint, Flaws]:
    """
    Return the newest checkpoint of a journal, and what of it was left out.

    ValueError where there is none.
    """
    read = _Read()
    for kind, arrays in records(data):
        if kind == 'bad':
            read.damaged += 1
            continue
        try:
            wrong = record_fault(arrays)
            if not wrong:
                _take(read, kind, arrays)
        except DAMAGED:
            wrong = 'what does not fit together'
        if wrong:
            read.refused[f'{RECORDS.get(kind, "a record")}: {wrong}'] += 1
    if read.newest is None:
        raise ValueError('it holds no checkpoint')
    flaws = Flaws(read.damaged, read.refused)
    newest = replace(read.newest, closed=read.closed and flaws == Flaws(0, {}))
    return _made_good(read, newest), flaws


def _take(read: _Read, kind: str, a: dict[str, Array]) -> None:
    """Add one record; raise one of DAMAGED where it does not fit."""
    if kind == 'view':
        read.views[int(a['k'])] = float(a['stamp']), _cloud(a)
    elif kind == 'pair':
        first, second = a['views'].tolist()
        read.constraints[int(a['k'])] = Constraint(first, second, a['z'].reshape(3),
                                                   a['R'].reshape(3, 3))
    elif kind == 'scan':
        read.scans[int(a['n'])] = MapScan(int(a['view']), a['pose'].reshape(3), _outline(a))
    elif kind == 'drop':
        for number in a['numbers'].tolist():
            read.scans.pop(number, None)
    elif kind == 'void':    # of earlier versions, which kept nothing of such views
        for k in a['views'].tolist():
            read.views[k] = read.views.get(k, (np.nan, NOTHING))[0], NOTHING
    elif kind == 'path':
        read.trail = np.concatenate([read.trail[:int(a['first'])], a['rows'].reshape(-1, 5)])
    elif kind == 'now':
        read.newest, read.closed = _now(read, a), False
    elif kind in (OPENED, CLOSED):
        read.closed = kind == CLOSED


def _now(read: _Read, a: dict[str, Array]) -> Checkpoint:
    """Return the checkpoint that is whole with this record."""
    poses, view = a['poses'].reshape(-1, 3).copy(), int(a['view'])
    if not 0 <= view < len(poses):
        raise ValueError('it was at a view that it does not hold')
    return Checkpoint(
        poses=poses, stamps=np.zeros(0), clouds=(), constraints=(), scans=(),
        trail=read.trail, to_close=tuple(a['to_close'].tolist()), view=view,
        tracker=TrackerState.from_arrays({name: a[name] for name in SHAPES}),
        epoch=Epoch.read(a['epoch'].tobytes().decode()),
        around=_views(a, 'around', len(poses)), fresh=_views(a, 'fresh', len(poses)))


def _views(a: dict[str, Array], name: str, n: int) -> tuple[int, ...]:
    """Return which of n views an array names; none where an earlier version wrote no such."""
    return tuple(k for k in a.get(name, np.zeros(0, int)).tolist() if 0 <= k < n)


def _made_good(read: _Read, newest: Checkpoint) -> Checkpoint:
    """Fill in what damaged records leave open, and leave out what hangs on nothing."""
    n = len(newest.poses)
    views = [read.views.get(k, (np.nan, NOTHING)) for k in range(n)]
    stamps = np.array([stamp for stamp, _ in views])
    known = np.isfinite(stamps)
    if not known.any():
        raise ValueError('all its views are damaged')
    stamps = np.interp(np.arange(n), np.flatnonzero(known), stamps[known])
    trail = newest.trail[(newest.trail[:, 1] >= 0) & (newest.trail[:, 1] < n)]
    if not len(trail):
        trail = np.array([[stamps[newest.view], newest.view, 0.0, 0.0, 0.0]])
    return replace(
        newest, stamps=stamps, clouds=[cloud for _, cloud in views],
        constraints=_complete(read, newest.poses),
        scans=[scan for _, scan in sorted(read.scans.items()) if 0 <= scan.view < n],
        trail=trail, to_close=tuple(k for k in newest.to_close if 0 <= k < n))


def _complete(read: _Read, poses: Array) -> list[Constraint]:
    """Return the constraints by age; a view that none introduces hangs on the one before it."""
    complete: list[Constraint] = []
    known = 1
    for _, constraint in sorted(read.constraints.items()):
        if not 0 <= min(constraint.first, constraint.second) or (
                max(constraint.first, constraint.second) >= len(poses)):
            continue
        while known < max(constraint.first + 1, constraint.second):
            complete.append(_along(known, poses))
            known += 1
        complete.append(constraint)
        known = max(known, constraint.second + 1)
    return complete + [_along(k, poses) for k in range(known, len(poses))]


def _along(k: int, poses: Array) -> Constraint:
    """Return a constraint of a view to the one before it that is made of their poses."""
    return Constraint(k - 1, k, between(poses[k - 1], poses[k]), MADE_GOOD)


def _cloud(a: dict[str, Array]) -> Cloud:
    """Return the cloud of a view's record."""
    noise, spacing = a['scatter'].tolist()
    points, normals = a['points'].astype(float), a['normals'].astype(float)
    if points.shape != normals.shape or points.ndim != 2 or points.shape[1] != 2:
        raise ValueError('points and normals do not fit')
    return Cloud(points, normals, _outline(a), noise, spacing=spacing)


def _outline(a: dict[str, Array]) -> Outline:
    """Return the outline of a record."""
    ends, reach = a['ends'].astype(np.float32), a['reach'].astype(np.float32)   # copies
    if ends.shape != (len(reach), 2) or a['origin'].shape != (2,):
        raise ValueError('beams do not fit their reach')
    hit = np.unpackbits(a['hit'], count=len(reach)).astype(bool)
    return Outline(ends, reach, hit, a['origin'])
