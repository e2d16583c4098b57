# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every decoder of bytes and of files, given anything: it reads them, or says in one line why not.

Round trips are tested beside each. Here what is good is cut, flipped, or has noise in it, and no
more is allocated before it is refused than a bound that stands beside each decoder.
"""

from collections.abc import Callable
from functools import cache
import io
import json
from pathlib import Path
import struct
import tempfile
import tracemalloc
from typing import Any, NamedTuple
import zipfile
import zlib

from helpers import fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import read_map, write_map
from somfusion_ros.io.parameters import read_parameters
from somfusion_ros.io.result import EVIDENCE, read_evidence, read_result, RESULT, write_robot_map
from somfusion_ros.io.trajectories import read_tum, write_tum
from somfusion_ros.slam.checkpoint_file import load_checkpoint
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.journal import packed, records
from somfusion_ros.team.bond_codec import decode_bonds, encode_bonds, SIZE, ToldBond
from somfusion_ros.team.bond_message import BondMessage
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.kept_views import decode_kept, encode_kept
from somfusion_ros.team.map_codec import MapDecoder, MapEncoder
from somfusion_ros.team.shared_map import MapCells
from somfusion_ros.team.view_facts import encode_constraint, Facts
from somfusion_ros.team.view_store import encode_batches, ViewStore

MEGABYTE = 2 ** 20
ENDLESS = b'{"version": 3, "bonds": [["a", "b", "1f.3", "1f.3", 1e999]]}'
MOST_CELLS = 10 ** 4
EPOCH = Epoch('1f', 3)
P = np.diag([1e-4, 1e-4, 1e-6])
ROOM = fake_grid(fake_room(3.0, 2.0))
TEMPORARY = tempfile.TemporaryDirectory()      # until the process ends
FOLDER = Path(TEMPORARY.name)


class Case(NamedTuple):
    """Good bytes, what reads them, and what that may allocate beside ten times their size."""

    good: bytes
    read: Callable[[bytes], Any]
    bound: int = MEGABYTE


def bonds() -> bytes:
    """Tell two bonds."""
    return encode_bonds([ToldBond('a', other, (EPOCH, EPOCH), tuple(
        InterMatch('a', k, other, k, np.array([0.1 * k, 0.2, 0.3]), P) for k in range(5)))
        for other in 'bc'])


def batch() -> bytes:
    """Tell some constraints of a path."""
    return encode_batches(EPOCH, 't', Facts((), tuple(
        encode_constraint(Constraint(k, k + 1, np.array([0.3, 0.1 * k, 0.2]), P))
        for k in range(9))))[0]


def change_of() -> tuple[bytes, Callable[[bytes], Any]]:
    """Tell a change of a map, to one who has the map."""
    encoder, decoder = MapEncoder(), MapDecoder(MOST_CELLS)
    values = ROOM.to_occupancy()
    encoder.encode(MapCells(values, 0.05, Pose()), EPOCH)
    decoder.decode(encoder.key)
    values = values.copy()
    values[10:20, 10:30] = 100
    encoder.encode(MapCells(values, 0.05, Pose()), EPOCH)
    assert encoder.change
    return encoder.change, decoder.decode


def file_of(name: str, read: Callable[[Path], Any]) -> Callable[[bytes], Any]:
    """Return what reads the bytes of a file of a name."""
    def reader(data: bytes) -> Any:
        path = FOLDER / name
        path.write_bytes(data)
        return read(path)
    return reader


def written(name: str, write: Callable[[Path], Any]) -> bytes:
    """Return the bytes of a file that something writes into a folder."""
    write(FOLDER)
    return (FOLDER / name).read_bytes()


@cache
def cases() -> dict[str, Case]:
    """Make every decoder its good bytes."""
    write_map(FOLDER, ROOM)
    tum = written('t.tum', lambda folder: write_tum(folder / 't.tum', range(5), np.ones((5, 3))))
    evidence = written(EVIDENCE, lambda folder: write_robot_map(folder, ROOM))
    pgm, yaml = ((FOLDER / f'map.{kind}').read_bytes() for kind in ('pgm', 'yaml'))
    text = json.dumps({'robots': {'a': {'scans': 5}}, 'pairs': [], 'transforms': {}}).encode()
    parameters = b'/**:\n  ros__parameters:\n    estimation_rate: 0.5\n'
    journal = b''.join(packed(kind, {'x': np.arange(9.0)}) for kind in ('abc', 'def'))

    def map_of(name: str) -> Callable[[bytes], Any]:
        def read(data: bytes) -> Any:
            for kind, good in (('pgm', pgm), ('yaml', yaml)):
                (FOLDER / f'map.{kind}').write_bytes(data if kind == name else good)
            return read_map(FOLDER / 'map.yaml')
        return read
    return {
        'bonds': Case(bonds(), lambda data: decode_bonds(data, 'a')),
        'message of bonds': Case(BondMessage('ab', 7, bonds()).encode(), BondMessage.decode),
        'views': Case(batch(), lambda data: ViewStore().take(data)),
        'kept views': Case(encode_kept([batch()] * 3, bonds()), decode_kept),
        'change of a map': Case(*change_of()),
        'journal': Case(journal, lambda data: list(records(data))),
        'state of a robot': Case(journal, file_of('state', load_checkpoint)),
        'image of a map': Case(pgm, map_of('pgm')),
        'yaml of a map': Case(yaml, map_of('yaml')),
        'trajectory': Case(tum, file_of('t.tum', read_tum)),
        'result': Case(text, file_of(RESULT, lambda path: read_result(path.parent))),
        'evidence': Case(evidence, file_of(EVIDENCE, lambda path: read_evidence(path.parent))),
        'parameters': Case(parameters, file_of('p.yaml', lambda path: read_parameters([path])))}


def refused(case: Case, data: bytes) -> str:
    """Read bytes; return why they are refused, '' where they are not."""
    tracemalloc.start()
    try:
        case.read(data)
    except ValueError as error:
        assert '\n' not in str(error)
        assert len(str(error)) < 600
        return str(error) or 'refused'
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < case.bound + 10 * max(len(data), len(case.good))
    return ''


NAMES = tuple(cases())


@pytest.mark.parametrize('name', NAMES)
def test_what_is_good_is_read(name: str) -> None:
    case = cases()[name]
    assert not refused(case, case.good) or name == 'state of a robot'


@pytest.mark.parametrize('name', NAMES)
@settings(max_examples=50, deadline=None)
@given(st.data())
def test_what_is_cut_flipped_or_noisy_is_read_or_refused_in_one_line(name: str, data: st.DataObject
                                                                     ) -> None:
    case = cases()[name]
    spoilt = bytearray(case.good)
    at = data.draw(st.integers(0, len(spoilt) - 1))
    how = data.draw(st.sampled_from(('cut', 'flip', 'noise', 'all noise')))
    if how == 'cut':
        del spoilt[at:]
    elif how == 'flip':
        spoilt[at] ^= data.draw(st.integers(1, 255))
    elif how == 'noise':
        spoilt[at:at] = data.draw(st.binary(max_size=40))
    else:
        spoilt = bytearray(data.draw(st.binary(max_size=300)))
    refused(case, bytes(spoilt))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=8), inner,
                                                                max_size=4), max_leaves=12)


@settings(max_examples=100, deadline=None)
@given(JSON | st.fixed_dictionaries({'version': st.just(3), 'bonds': st.lists(st.tuples(
    *[st.sampled_from(('a', 'b', 'c', '', '1f.3', '\x00')) | JSON] * 4,
    st.integers(-3, 10 ** 9) | st.floats()), max_size=3)}))
def test_any_head_of_bonds_is_read_or_refused(document: Any) -> None:
    head = json.dumps(document).encode()
    refused(cases()['bonds'], SIZE.pack(len(head)) + head + bonds()[-80:])


def npz(shape: tuple[int, ...]) -> bytes:
    """Write a file that says that its evidence has a shape, and holds ten cells."""
    head, file = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {'descr': '<f8', 'fortran_order': False, 'shape': shape})
    with zipfile.ZipFile(file, 'w') as archive:
        archive.writestr('evidence.npy', head.getvalue() + bytes(80))
    return file.getvalue()


def png(width: int, height: int) -> bytes:
    """Write an image that says that it has a size, and holds nothing."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(
            kind + data))
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack(
        '>IIBBBBB', width, height, 8, 0, 0, 0, 0)) + chunk(b'IDAT', b'') + chunk(b'IEND', b'')


@pytest.mark.parametrize(('name', 'data', 'why'), [
    ('evidence', npz((20000, 20000)), 'too large'),
    ('evidence', npz((10 ** 9, 10 ** 9)), 'too large'),
    ('image of a map', b'P5\n20000 20000\n255\n', 'makes no sense'),
    ('image of a map', b'P5\n16000 16000\n255\n' + bytes(100), 'truncated'),
    ('image of a map', b'P2\n16000 16000\n255\n' + b'7 ' * 100, 'truncated'),
    ('image of a map', png(20000, 20000), 'too large'),
    ('yaml of a map', b'a: &a [' + b'x, ' * 1000 + b']\n' + b''.join(
        b'b%d: &b%d [*a, *a, *a, *a]\n' % (k, k) for k in range(200)), "no 'image'"),
    ('bonds', SIZE.pack(2 ** 32 - 1) + b'{}', 'bonds'),
    ('bonds', SIZE.pack(len(ENDLESS)) + ENDLESS, 'bonds'),
    ('journal', packed('abc', {})[:12] + struct.pack('<II', 2 ** 28, 0), '')])
def test_absurd_sizes_cost_nothing(name: str, data: bytes, why: str) -> None:
    assert why in refused(cases()[name], data)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 2), min_size=12, max_size=12), st.floats(0.01, 1.0),
       st.floats(-99, 99), st.floats(-3, 3))
def test_a_map_and_its_evidence_come_back(cells: list[int], resolution: float, x: float,
                                          theta: float) -> None:
    grid = Grid(np.array(cells).reshape(3, 4) - 1.0, resolution, Pose(x, -x, theta))
    write_robot_map(FOLDER, grid)
    for again in (read_map(FOLDER / 'map.yaml'), read_evidence(FOLDER)):
        assert np.array_equal(again.to_occupancy(), grid.to_occupancy())
        assert np.allclose(again.T_frame_grid, grid.T_frame_grid)
        assert again.resolution == grid.resolution


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-1e4, 1e4)] * 3), max_size=9))
def test_a_trajectory_comes_back(rows: list[tuple[float, float, float]]) -> None:
    poses = np.array(rows).reshape(-1, 3)
    write_tum(FOLDER / 't.tum', np.arange(len(rows)), poses)
    stamps, again = read_tum(FOLDER / 't.tum')
    assert np.array_equal(stamps, np.arange(len(rows)))
    assert np.allclose(again[:, :2], poses[:, :2], atol=1e-6)
    assert np.allclose(np.cos(again[:, 2] - poses[:, 2]), 1.0)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99), *[st.floats(-50, 50)] * 3),
                max_size=6))
def test_bonds_come_back(rows: list[tuple[Any, ...]]) -> None:
    told = [ToldBond('a', 'b', (EPOCH, EPOCH), tuple(
        InterMatch('a', i, 'b', j, np.array(z), P) for i, j, *z in rows))]
    again, = decode_bonds(encode_bonds(told), 'a')
    assert again[:3] == told[0][:3]
    for one, other in zip(again.matches, told[0].matches, strict=True):
        assert (one.target, one.target_view, one.source_view) == (
            'a', other.target_view, other.source_view)
        assert np.allclose(one.z, other.z, atol=1e-3)
    kept = decode_kept(encode_kept([batch(), b'x'], encode_bonds(told)))
    assert kept == ([batch(), b'x'], encode_bonds(told))
