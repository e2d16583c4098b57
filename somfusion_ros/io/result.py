# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command leaves in its output folder: result.json, and every map with its evidence."""

from collections.abc import Mapping, Sequence
import io
import json
import math
from pathlib import Path
from textwrap import shorten
from typing import Any, TYPE_CHECKING
import zipfile

import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid, MAX_CELLS
from somfusion_ros.io.errors import InputError
from somfusion_ros.io.maps import write_map
from somfusion_ros.whole_files import write_files, write_text

if TYPE_CHECKING:
    from somfusion_ros.team.bond import Bond
    from somfusion_ros.team.offline import Fusion, PairResult

RESULT, EVIDENCE = 'result.json', 'evidence.npz'
SAID = 200     # characters, at most, of what a library says of a damaged file


def fusion_record(fusion: 'Fusion') -> dict[str, Any]:
    """
    Describe a fusion for result.json: pairs, transforms, unconnected, verification_index.

    map_of: whose maps the joint map shows; groups: which are joined with one another, the largest
    group first; map_note: what a reader of the joint map would take for granted wrongly, or ''.
    """
    bonds = ({frozenset(bond.pair): bond for bond in fusion.elastic.bonds} if fusion.elastic
             else {})
    return {
        'pairs': [{**pair_record(pair), **bond_record(bonds.get(
            frozenset((pair.target, pair.source)), pair.bond))} for pair in fusion.pairs],
        'transforms': {robot: pose_record(fusion.world[robot]) for robot in fusion.world},
        'unconnected': list(fusion.unconnected),
        'verification_index': fusion.verification_index,
        'dropped': [item.reason for item in fusion.solution.dropped],
        'map_of': list(fusion.world),
        'groups': [list(group) for group in fusion.solution.groups],
        'map_note': map_note([list(group) for group in fusion.solution.groups]),
    }


def map_note(groups: Sequence[Sequence[str]]) -> str:
    """Say which of the maps are not in the joint map, and where they are; '' if all are in it."""
    shown, *others = groups
    if not others:
        return ''
    alone = len(shown) == 1
    note = (f'no maps were joined: the joint map is that of {shown[0]} alone, the first by name'
            if alone else f'the joint map is that of {", ".join(shown)}')
    apart = ', '.join(f'{name} in {name}/map.yaml' for group in others for name in group)
    also = [' and '.join(group) for group in others if len(group) > 1]
    return f'{note}; not in it: {apart}' + (
        f'; joined with one another, but not drawn: {"; ".join(also)}' if also else '')


def pair_record(pair: 'PairResult') -> dict[str, Any]:
    """Describe one pair for result.json."""
    found = pair.alignment
    rival = found.runner_up
    return {
        'target': pair.target,
        'source': pair.source,
        'accepted': bool(found.accepted),
        'probability': float(found.probability),
        'reason': found.reason,
        'transform': pose_record(found.T_target_source),
        'covariance': np.asarray(found.covariance).tolist(),
        'verification_index': float(found.verification_index),
        'performance_index': [float(j) for j in found.performance_index],
        'overlap': float(found.overlap),
        'runner_up': None if rival is None else {
            'transform': pose_record(rival.T_target_source),
            'probability': float(rival.probability)},
        'seconds': {stage: float(s) for stage, s in found.seconds.items()},
    }


def bond_record(bond: 'Bond | None') -> dict[str, Any]:
    """Describe what the views of a pair say, for result.json; {} where they were not asked."""
    if bond is None:
        return {}
    return {
        'elastic': bond.holds,
        'elastic_reason': bond.reason,
        'confirmed': bond.confirmation.share,
        'views_asked': bond.confirmation.asked,
        'views_matched': len(bond.matches),
        'weakest_direction_m': bond.weakest,
        'bend_m': bond.bend,
        'walls_agree_rigid': bond.before,
        'walls_agree_elastic': bond.after,
    }


def pose_record(pose: Pose | None) -> dict[str, float] | None:
    """Describe a transform [m, rad]."""
    return None if pose is None else dict(zip(('x', 'y', 'theta'), (float(v) for v in pose)))


def pose_of(record: Mapping[str, float] | None) -> Pose | None:
    """Make a transform of its description."""
    return None if record is None else Pose(record['x'], record['y'], record['theta'])


def write_result(folder: Path, record: Mapping[str, Any]) -> None:
    """Write result.json; what is not finite becomes null, as JSON has no word for it."""
    write_text(folder / RESULT, json.dumps(_finite(record), indent=2, allow_nan=False) + '\n')


def read_result(folder: Path) -> dict[str, Any]:
    """Read result.json; InputError where the folder holds no result."""
    path = folder / RESULT
    try:
        record: dict[str, Any] = json.loads(path.read_text())
        named = [pair[role] for pair in record['pairs'] for role in ('target', 'source')]
        placed = [pose_of(record['transforms'][name]) for name in record['transforms']]
        if not {*named, *record['transforms']} <= record['robots'].keys() or None in placed:
            raise KeyError('robots')
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}') from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f'{path}: not a result of replay or merge') from error
    return record


def write_robot_map(folder: Path, grid: Grid) -> None:
    """Write a map as map.yaml and map.pgm, and its evidence unrounded for the report."""
    write_map(folder, grid)
    archive = io.BytesIO()
    np.savez_compressed(archive, evidence=grid.evidence, resolution=grid.resolution,
                        origin=np.array(grid.T_frame_grid))
    write_files({folder / EVIDENCE: archive.getvalue()})


def read_evidence(folder: Path) -> Grid:
    """Read a map written by `write_robot_map`."""
    path = folder / EVIDENCE
    try:
        _check_cells(path)
        with np.load(path) as data:
            return Grid(data['evidence'], float(data['resolution']),
                        Pose.from_array(data['origin']))
    except OSError as error:
        raise InputError(f'{path}: {error.strerror or "not readable"}') from error
    except Exception as error:   # numpy and zipfile raise many kinds on a damaged file
        raise InputError(f'{path}: damaged ({shorten(str(error), SAID)})') from error


def _check_cells(path: Path) -> None:
    """Raise ValueError where evidence says that it has more cells than a map can have."""
    with zipfile.ZipFile(path) as archive, archive.open('evidence.npy') as file:
        np.lib.format.read_magic(file)
        shape = np.lib.format.read_array_header_1_0(file)[0]
    if math.prod(shape) > MAX_CELLS:
        raise ValueError(f'evidence of {shape} cells is too large')


def make_folder(path: str | Path) -> Path:
    """Make an output folder; InputError where that is not possible."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{folder}: cannot be the output folder ({error.strerror})') from error
    return folder


def _finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, all through a record."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
