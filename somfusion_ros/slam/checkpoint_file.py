# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A checkpoint of one robot's SLAM in a file, so that a robot goes on with its map after a restart.

An npz of numbers only. It is written beside its place and then put there in one step: whenever
the power goes, the file is either the old one or the new one.
"""

from collections import deque
from collections.abc import Sequence
import os
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
import zlib

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam.checkpoint import Checkpoint, ViewGraph
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.mapping import MapScan
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.tracker_state import TrackerState

VERSION = 5
PARTS = {'surface': ('points', 'normals'), 'beams': ('ends', 'reach', 'hit')}   # of a cloud
TRACKER = 'tracker_'
DAMAGED = (BadZipFile, zlib.error, EOFError, KeyError, ValueError, IndexError, TypeError)


def save_checkpoint(path: str | Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint with at least one view; clouds are kept in single precision (0.01 mm)."""
    path = Path(path)
    graph = checkpoint.graph
    clouds = {id(c): c for c in (*graph.clouds, *(s.cloud for s in graph.scans))}
    place = {key: index for index, key in enumerate(clouds)}
    views, hung = [s.view for s in graph.scans], [s.T_view_base for s in graph.scans]
    arrays: dict[str, Any] = {
        'version': np.array(VERSION), 'poses': checkpoint.poses,
        'stamps': np.array(graph.stamps),
        'constraints': np.array([(c.first, c.second) for c in graph.constraints],
                                int).reshape(-1, 2),
        'z': np.array([r.z for r in graph.constraints]).reshape(-1, 3),
        'R': np.array([r.R for r in graph.constraints]).reshape(-1, 3, 3),
        'scan_views': np.array(views, int), 'scan_poses': np.array(hung).reshape(-1, 3),
        'scan_clouds': np.array([place[id(s.cloud)] for s in graph.scans], int),
        'track': np.array([(t, view, *pose) for t, view, pose in graph.track]).reshape(-1, 5),
        'to_close': np.array(graph.to_close, int),
        'epoch': np.frombuffer(str(graph.epoch).encode(), np.uint8),
        'origins': np.array([c.outline.origin for c in clouds.values()]).reshape(-1, 2),
        **_packed(list(clouds.values())),
        **{f'{TRACKER}{name}': value for name, value in checkpoint.tracker.arrays().items()}}
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f'{path.name}.new')
    with beside.open('wb') as file:
        np.savez(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)


def load_checkpoint(path: str | Path) -> Checkpoint:
    """
    Read a checkpoint.

    FileNotFoundError where there is none; ValueError, naming the file, where it cannot be used.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if int(arrays['version']) != VERSION:
            raise ValueError(f'it has version {arrays["version"]}, this is {VERSION}')
        return _checkpoint(arrays)
    except DAMAGED as error:
        raise ValueError(f'{path}: not a usable checkpoint ({error})') from error


def _checkpoint(a: dict[str, Any]) -> Checkpoint:
    """Assemble a checkpoint; raise one of DAMAGED where the arrays do not fit."""
    if not all(np.isfinite(value).all() for value in a.values()):
        raise ValueError('it holds what is no number')
    n, clouds = len(a['poses']), _unpacked(a)
    if not (0 < n == len(a['stamps']) <= len(clouds) and len(a['track'])
            and len(a['constraints']) >= n - 1):
        raise ValueError(f'{n} views do not fit the rest')
    indices = [(a['constraints'], n), (a['scan_views'], n), (a['scan_clouds'], len(clouds)),
               (a['track'][:, 1], n), (a['to_close'], n)]
    if any((values < 0).any() or (values >= limit).any() for values, limit in indices):
        raise ValueError('it refers to what it does not hold')
    graph = ViewGraph(
        clouds=clouds[:n], centres=[centre(cloud) for cloud in clouds[:n]],
        stamps=a['stamps'].tolist(),
        constraints=[Constraint(int(i), int(j), z, R) for (i, j), z, R
                     in zip(a['constraints'], a['z'], a['R'], strict=True)],
        scans=[MapScan(int(view), pose, clouds[cloud]) for view, pose, cloud in
               zip(a['scan_views'], a['scan_poses'], a['scan_clouds'], strict=True)],
        track=[(float(row[0]), int(row[1]), row[2:]) for row in a['track']],
        to_close=deque(a['to_close'].tolist()),
        epoch=_epoch(a['epoch'].tobytes()))
    tracker = TrackerState.from_arrays({name.removeprefix(TRACKER): value for name, value
                                        in a.items() if name.startswith(TRACKER)})
    return Checkpoint(graph, a['poses'], tracker)


def _epoch(text: bytes) -> Epoch:
    """Read which map it is; one that was made offline has no start."""
    return Epoch() if text == str(Epoch()).encode() else Epoch.parse(text.decode())


def _packed(clouds: Sequence[Cloud]) -> dict[str, Array]:
    """Concatenate the parts of all clouds, with the length of each."""
    packed = {}
    for whole, parts in PARTS.items():
        owners = [cloud if whole == 'surface' else cloud.outline for cloud in clouds]
        for part in parts:
            every = [getattr(owner, part) for owner in owners]
            packed[part] = np.concatenate(every).astype(np.float32)
        packed[f'{whole}_lengths'] = np.array([len(one) for one in every], int)
    return packed


def _unpacked(a: dict[str, Any]) -> list[Cloud]:
    """Split what `_packed` has concatenated."""
    split = []
    for whole, parts in PARTS.items():
        ends = np.cumsum(a[f'{whole}_lengths'])
        for part in parts:
            if len(a[part]) != (ends[-1] if len(ends) else 0):
                raise ValueError(f'{part} do not fit their lengths')
            split.append(np.split(a[part].astype(float), ends[:-1]))
    return [Cloud(points, normals, Outline(ends, reach, hit > 0.5, origin))
            for points, normals, ends, reach, hit, origin in zip(*split, a['origins'],
                                                                 strict=True)]
