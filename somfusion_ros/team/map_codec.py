# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Maps as bytes: a compressed key map now and then, and between two of them only what changed.

A change is told against its key, never against an earlier change, so that one key and the newest
change are all that a reader needs: whatever is lost, late, doubled or out of order in between
does no harm. It holds the differences of the cells in the smallest rectangle that has any.
Both carry a digest of the result, so that a map is either what the sender had or nothing.
"""

from dataclasses import dataclass
from hashlib import blake2b
import struct
from typing import NamedTuple
import zlib

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import UNKNOWN
from somfusion_ros.settings import tuned
from somfusion_ros.team.shared_map import MapCells

KEY, CHANGE = b'SOMKEY1', b'SOMCHG1'
# Kind of message, digest of the key and of the result; rows, columns, resolution and origin of
# the result; first row and column of the key in it; rectangle of the change: row, column, size.
HEADER = struct.Struct('<7s8s8sII4d2i4I')
LEVEL = 6             # of zlib
MAX_SHIFT = 1 << 20   # cells that a map may grow beyond its key


@dataclass(frozen=True)
class CodecTuning:
    """When two maps lie on one lattice."""

    whole: float = tuned(
        1e-3, 'cells', 'lattices that are nearer to a whole number of cells apart are one',
        'by design')


TUNING = CodecTuning()


class Header(NamedTuple):
    """What precedes the compressed cells."""

    kind: bytes
    key: bytes
    digest: bytes
    rows: int
    columns: int
    resolution: float
    x: float
    y: float
    theta: float
    key_row: int
    key_column: int
    row: int
    column: int
    height: int
    width: int


class MapEncoder:
    """Encodes a robot's maps as messages: `key`, and `change` or None, are what counts now."""

    def __init__(self) -> None:
        self.key = b''
        self.change: bytes | None = None
        self._cells: MapCells | None = None
        self._spent = 0

    def encode(self, cells: MapCells) -> None:
        """Encode the newest map; a new key is made once the changes have cost as much as one."""
        corner = None if self._cells is None else _corner(self._cells, cells)
        if corner is not None and self._spent < len(self.key):
            self.change = self._difference(cells, corner)
            self._spent += len(self.change)
        if corner is None or self._spent >= len(self.key):
            self.key, self.change, self._cells, self._spent = _key(cells), None, cells, 0

    def _difference(self, cells: MapCells, corner: tuple[int, int]) -> bytes:
        """Message of what differs from the key, whose corner lies at (row, column) of the map."""
        differs = cells.values ^ _moved(self._cells.values, cells.values.shape, corner)
        rows, columns = np.flatnonzero(differs.any(1)), np.flatnonzero(differs.any(0))
        box = ((0, 0, 0, 0) if not len(rows) else
               (rows[0], columns[0], rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]))
        row, column, height, width = (int(value) for value in box)
        header = _header(CHANGE, cells, _digest(self._cells), corner, (row, column, height, width))
        part = differs[row:row + height, column:column + width]
        return header + zlib.compress(part.tobytes(), LEVEL)


class MapDecoder:
    """Decodes messages to maps, in whatever order they come."""

    def __init__(self, max_cells: int) -> None:
        self._max_cells = max_cells
        self._key: tuple[bytes, MapCells] | None = None
        self._change: bytes | None = None

    def decode(self, message: bytes) -> MapCells | None:
        """
        Decode a message; return the newest map, None while its key is missing.

        ValueError, naming what is wrong, on anything that is no message; it changes nothing.
        """
        header = _parse(message, self._max_cells)
        if header.kind == KEY:
            self._key = header.digest, _cells(header, _inflate(message, header))
            return self._newest()
        if self._key is not None and self._key[0] == header.key:
            cells = self._apply(header, message)
            self._change = message
            return cells
        self._change = message
        return None

    def _newest(self) -> MapCells:
        """Return the key with the change that waited for it, if that is any good."""
        if self._change is not None:
            header = _parse(self._change, self._max_cells)
            if header.key == self._key[0]:
                try:
                    return self._apply(header, self._change)
                except ValueError:
                    self._change = None
        return self._key[1]

    def _apply(self, header: Header, message: bytes) -> MapCells:
        """Put a change on its key."""
        shape = header.rows, header.columns
        values = _moved(self._key[1].values, shape, (header.key_row, header.key_column))
        window = values[header.row:header.row + header.height,
                        header.column:header.column + header.width]
        window ^= _inflate(message, header)
        return _cells(header, values)


def _key(cells: MapCells) -> bytes:
    """Message of a whole map."""
    header = _header(KEY, cells, _digest(cells), (0, 0), (0, 0, *cells.values.shape))
    return header + zlib.compress(cells.values.tobytes(), LEVEL)


def _header(kind: bytes, cells: MapCells, key: bytes, corner: tuple[int, int],
            box: tuple[int, int, int, int]) -> bytes:
    """Header of a message about a map."""
    return HEADER.pack(kind, key, _digest(cells), *cells.values.shape, cells.resolution,
                       *cells.T_frame_grid, *corner, *box)


def _digest(cells: MapCells) -> bytes:
    """Eight bytes that no other map has."""
    geometry = struct.pack('<2I4d', *cells.values.shape, cells.resolution, *cells.T_frame_grid)
    return blake2b(np.ascontiguousarray(cells.values).data, digest_size=8, person=b'map',
                   salt=blake2b(geometry, digest_size=16).digest()).digest()


def _corner(key: MapCells, cells: MapCells) -> tuple[int, int] | None:
    """Row and column of the key's corner in a newer map; None where the lattices differ."""
    if key.resolution != cells.resolution or key.T_frame_grid.theta != cells.T_frame_grid.theta:
        return None
    at = compose(inverse(cells.T_frame_grid), key.T_frame_grid)[:2] / cells.resolution
    whole = np.rint(at)
    if np.abs(at - whole).max() > TUNING.whole or np.abs(whole).max() > MAX_SHIFT:
        return None
    return int(whole[1]), int(whole[0])


def _moved(values: NDArray[np.int8], shape: tuple[int, int],
           corner: tuple[int, int]) -> NDArray[np.int8]:
    """Cells laid into an unknown map of another shape, with their corner at (row, column)."""
    result = np.full(shape, UNKNOWN, np.int8)
    here, there = zip(*(_overlap(first, count, size) for first, count, size in
                        zip(corner, values.shape, shape)), strict=True)
    result[here] = values[there]
    return result


def _overlap(first: int, count: int, size: int) -> tuple[slice, slice]:
    """Slices of the cells that a row of `count` shares with one of `size`, in both."""
    low, high = max(first, 0), max(min(first + count, size), 0)
    low = min(low, high)
    return slice(low, high), slice(low - first, high - first)


def _parse(message: bytes, max_cells: int) -> Header:
    """Read and check a header; ValueError on what no map can have."""
    if (not HEADER.size < len(message) <= HEADER.size + 2 * max_cells
            or message[:len(KEY)] not in (KEY, CHANGE)):
        raise ValueError(f'{len(message)} bytes are no map message')
    header = Header(*HEADER.unpack_from(message))
    if not 0 < header.rows * header.columns <= max_cells:
        raise ValueError(f'map of {header.columns} x {header.rows} cells: none, or over '
                         f'{max_cells}')
    if (header.row + header.height > header.rows
            or header.column + header.width > header.columns):
        raise ValueError('the change lies outside its map')
    if max(abs(header.key_row), abs(header.key_column)) > MAX_SHIFT:
        raise ValueError('the change lies too far from its key')
    if header.kind == KEY and (header.height, header.width) != (header.rows, header.columns):
        raise ValueError('the key map is not whole')
    return header


def _inflate(message: bytes, header: Header) -> NDArray[np.int8]:
    """Decompress the rectangle of a message, and not a byte more."""
    size, engine = header.height * header.width, zlib.decompressobj()
    try:
        data = engine.decompress(message[HEADER.size:], size + 1)
    except zlib.error as error:
        raise ValueError(f'map message cannot be decompressed: {error}') from error
    if len(data) != size:
        raise ValueError(f'map message holds {len(data)} cells instead of {size}')
    return np.frombuffer(data, np.int8).reshape(header.height, header.width)


def _cells(header: Header, values: NDArray[np.int8]) -> MapCells:
    """Put a map together; ValueError unless it is the sender's."""
    cells = MapCells(values, header.resolution, Pose(header.x, header.y, header.theta))
    if not np.isfinite((header.resolution, *cells.T_frame_grid)).all():
        raise ValueError('map message with a resolution or an origin that is not finite')
    if _digest(cells) != header.digest:
        raise ValueError('map message does not give the map that it was made of')
    return cells
