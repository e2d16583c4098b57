# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The state of one robot's SLAM in a file, so that a robot goes on with its map after a restart.

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
from somfusion_ros.slam.checkpoint import Memory, State
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Relation
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.loops import centre
from somfusion_ros.slam.mapping import MapScan
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.tracking import Tracker

VERSION = 3
PARTS = {'surface': ('points', 'normals'), 'beams': ('ends', 'reach', 'hit')}   # of a cloud
TRACKER = 'tracker_'
DAMAGED = (BadZipFile, zlib.error, EOFError, KeyError, ValueError, IndexError, TypeError)


def save_state(path: str | Path, state: State) -> None:
    """Write a state with at least one view; clouds are kept in single precision (0.01 mm)."""
    path = Path(path)
    m = state.memory
    clouds = {id(c): c for c in (*m.clouds, *(s.cloud for s in m.scans))}
    place = {key: index for index, key in enumerate(clouds)}
    views, hung = [s.view for s in m.scans], [s.T_view_base for s in m.scans]
    arrays: dict[str, Any] = {
        'version': np.array(VERSION), 'poses': state.poses, 'stamps': np.array(m.stamps),
        'relations': np.array([(r.first, r.second) for r in m.relations], int).reshape(-1, 2),
        'z': np.array([r.z for r in m.relations]).reshape(-1, 3),
        'R': np.array([r.R for r in m.relations]).reshape(-1, 3, 3),
        'scan_views': np.array(views, int), 'scan_poses': np.array(hung).reshape(-1, 3),
        'scan_clouds': np.array([place[id(s.cloud)] for s in m.scans], int),
        'track': np.array([(t, view, *pose) for t, view, pose in m.track]).reshape(-1, 5),
        'to_close': np.array(m.to_close, int),
        'origins': np.array([c.outline.origin for c in clouds.values()]).reshape(-1, 2),
        **_packed(list(clouds.values())),
        **{f'{TRACKER}{name}': value for name, value in state.tracker.items()}}
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f'{path.name}.new')
    with beside.open('wb') as file:
        np.savez(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)


def load_state(path: str | Path) -> State:
    """
    Read a state.

    FileNotFoundError where there is none; ValueError, naming the file, where it cannot be used.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if int(arrays['version']) != VERSION:
            raise ValueError(f'it has version {arrays["version"]}, this is {VERSION}')
        return _state(arrays)
    except DAMAGED as error:
        raise ValueError(f'{path}: not a usable state ({error})') from error


def _state(a: dict[str, Any]) -> State:
    """Put a state together again; whatever does not fit raises one of DAMAGED."""
    if not all(np.isfinite(value).all() for value in a.values()):
        raise ValueError('it holds what is no number')
    n, clouds = len(a['poses']), _unpacked(a)
    if not (0 < n == len(a['stamps']) <= len(clouds) and len(a['track'])
            and len(a['relations']) >= n - 1):
        raise ValueError(f'{n} views do not fit the rest')
    indices = [(a['relations'], n), (a['scan_views'], n), (a['scan_clouds'], len(clouds)),
               (a['track'][:, 1], n), (a['to_close'], n)]
    if any((values < 0).any() or (values >= limit).any() for values, limit in indices):
        raise ValueError('it refers to what it does not hold')
    memory = Memory(
        clouds=clouds[:n], centres=[centre(cloud) for cloud in clouds[:n]],
        stamps=a['stamps'].tolist(),
        relations=[Relation(int(i), int(j), z, R) for (i, j), z, R in
                   zip(a['relations'], a['z'], a['R'], strict=True)],
        scans=[MapScan(int(view), pose, clouds[cloud]) for view, pose, cloud in
               zip(a['scan_views'], a['scan_poses'], a['scan_clouds'], strict=True)],
        track=[(float(row[0]), int(row[1]), row[2:]) for row in a['track']],
        to_close=deque(a['to_close'].tolist()))
    tracker = {name.removeprefix(TRACKER): value for name, value in a.items()
               if name.startswith(TRACKER)}
    fresh = Tracker(SlamConfig()).state()
    if {k: v.shape for k, v in tracker.items()} != {**{k: v.shape for k, v in fresh.items()},
                                                    'odometry': (7,)}:
        raise ValueError('its tracker is that of another version')
    return State(memory, a['poses'], tracker)


def _packed(clouds: Sequence[Cloud]) -> dict[str, Array]:
    """Put the parts of all clouds one after another, with the length of each."""
    packed = {}
    for whole, parts in PARTS.items():
        owners = [cloud if whole == 'surface' else cloud.outline for cloud in clouds]
        for part in parts:
            every = [getattr(owner, part) for owner in owners]
            packed[part] = np.concatenate(every).astype(np.float32)
        packed[f'{whole}_lengths'] = np.array([len(one) for one in every], int)
    return packed


def _unpacked(a: dict[str, Any]) -> list[Cloud]:
    """Take the clouds apart again."""
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
