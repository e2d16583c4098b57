# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Maps as bytes: a compressed key map now and then, and between two of them only what changed.

A change is told against its key, never against an earlier change, so that one key and the newest
change are all that a reader needs: whatever is lost, late, doubled or out of order in between
does no harm. It holds the differences of the cells in the smallest rectangle that has any.
Both carry a digest of the result, so that a map is either what the sender had or nothing, and the
epoch of the map, so that nothing of an earlier map is taken for part of this one.
"""

from hashlib import blake2b
import struct
from typing import NamedTuple
import zlib

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.lattice import corner_in, laid_into, MAX_SHIFT
from somfusion_ros.team.shared_map import MapCells

KEY, CHANGE = b'SOMKEY2', b'SOMCHG2'
# Kind and version of message, epoch, number, digest of the key and of the result; rows, columns,
# resolution and origin of the result; first row and column of the key in it; rectangle of the
# change: row, column, size.
HEADER = struct.Struct('<7s42sQ8s8sII4d2i4I')
LEVEL = 6             # of zlib


class Header(NamedTuple):
    """What precedes the compressed cells."""

    kind: bytes
    epoch: bytes
    number: int
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
        self._epoch, self._spent, self._number = Epoch(), 0, 0

    def encode(self, cells: MapCells, epoch: Epoch = Epoch()) -> None:
        """Encode the newest map; a new key is made once the changes have cost as much as one."""
        key = self._cells if epoch == self._epoch else None
        corner = None if key is None else corner_in(key, cells)
        if key is not None and corner is not None and self._spent < len(self.key):
            self.change = _difference(cells, epoch, self._next(), key, corner)
            self._spent += len(self.change)
        if corner is None or self._spent >= len(self.key):
            self.key, self.change = key_message(cells, epoch, self._next()), None
            self._cells, self._epoch, self._spent = cells, epoch, 0

    def _next(self) -> int:
        """Return the number of the next message."""
        self._number += 1
        return self._number


class MapDecoder:
    """
    Decodes messages to maps, in whatever order they come.

    newest: the last map, and which; own: the last that the robot itself told. A map that others
    tell has the number 0: changes that the robot tells are against its own keys.
    """

    def __init__(self, max_cells: int) -> None:
        self._max_cells, self._number = max_cells, 0
        self._key: tuple[bytes, MapCells] | None = None   # with its digest
        self._change: bytes | None = None    # the newest: shown, or it waits for its key, and
        self._changed = 0                    # its number
        self.newest: tuple[Epoch, MapCells] | None = None
        self.own: tuple[Epoch, MapCells] | None = None

    def restart(self) -> None:
        """Expect numbers from the beginning: the sender was started again."""
        self._number = self._changed = 0

    def is_stale(self, message: bytes) -> bool:
        """Return whether one like a message is newer, shown or waiting; 0 is of any age."""
        newest = self._number if message.startswith(KEY) else max(self._number, self._changed)
        return 0 < number_of(message) < newest

    def decode(self, message: bytes) -> MapCells | None:
        """
        Decode a message; return the newest map, None while its key is missing.

        ValueError, naming what is wrong, on anything that is no message; it changes nothing.
        """
        cells = self._decoded(message)
        if cells is not None:
            self.newest = epoch_of(message), cells
            if number := number_of(message):
                self.own, self._number = self.newest, number
        return cells

    def _decoded(self, message: bytes) -> MapCells | None:
        """Decode a message on top of those before."""
        header = _parse(message, self._max_cells)
        if header.kind == KEY:
            key = _cells(header, _inflate(message, header))
            if not header.number:
                return key
            self._key = header.digest, key
            return self._with_change(key, header.number)
        if self._key is None or self._key[0] != header.key:
            self._change, self._changed = message, header.number
            return None
        cells = _changed(self._key[1], header, message)
        self._change, self._changed = message, header.number
        return cells

    def _with_change(self, key: MapCells, number: int) -> MapCells:
        """Return a new key with the change that waited for it, if that is newer, and any good."""
        if self._change is not None and self._key is not None:
            header = _parse(self._change, self._max_cells)
            if header.key == self._key[0] and header.number > number:
                try:
                    return _changed(key, header, self._change)
                except ValueError:
                    self._change, self._changed = None, 0
        return key


def epoch_of(message: bytes) -> Epoch:
    """Return which map a message is about; ValueError on what is no map message."""
    if len(message) <= HEADER.size or message[:len(KEY)] not in (KEY, CHANGE):
        raise ValueError(f'{len(message)} bytes are no map message of this version')
    return _epoch(HEADER.unpack_from(message)[1])


def number_of(message: bytes) -> int:
    """Return the number of a map message, of which the header is enough; 0 where it has none."""
    if len(message) < HEADER.size or message[:len(KEY)] not in (KEY, CHANGE):
        return 0
    return Header(*HEADER.unpack_from(message)).number


def _epoch(field: bytes) -> Epoch:
    """Read the epoch in a header; ValueError where it is none."""
    text = field.rstrip(b'\0').decode('ascii', 'replace')
    return Epoch.read(text)


def _difference(cells: MapCells, epoch: Epoch, number: int, key: MapCells,
                corner: tuple[int, int]) -> bytes:
    """Encode what differs from the key, whose corner lies at (row, column) of the map."""
    differs = cells.values ^ laid_into(key.values, cells.values.shape, corner)
    rows, columns = np.flatnonzero(differs.any(1)), np.flatnonzero(differs.any(0))
    box = ((0, 0, 0, 0) if not len(rows) else
           (rows[0], columns[0], rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]))
    row, column, height, width = (int(value) for value in box)
    header = _header(CHANGE, epoch, number, cells, _digest(key, epoch), corner,
                     (row, column, height, width))
    part = differs[row:row + height, column:column + width]
    return header + zlib.compress(part.tobytes(), LEVEL)


def _changed(key: MapCells, header: Header, message: bytes) -> MapCells:
    """Put a change on its key."""
    shape = header.rows, header.columns
    values = laid_into(key.values, shape, (header.key_row, header.key_column))
    row, column = header.row, header.column
    values[row:row + header.height, column:column + header.width] ^= _inflate(message, header)
    return _cells(header, values)


def key_message(cells: MapCells, epoch: Epoch, number: int = 0) -> bytes:
    """Return the message of a whole map; without a number it counts whenever it comes."""
    header = _header(KEY, epoch, number, cells, _digest(cells, epoch), (0, 0),
                     (0, 0, *cells.values.shape))
    return header + zlib.compress(cells.values.tobytes(), LEVEL)


def _header(kind: bytes, epoch: Epoch, number: int, cells: MapCells, key: bytes,
            corner: tuple[int, int], box: tuple[int, int, int, int]) -> bytes:
    """Return the header of a message about a map."""
    return HEADER.pack(kind, str(epoch).encode(), number, key, _digest(cells, epoch),
                       *cells.values.shape, cells.resolution, *cells.T_frame_grid, *corner, *box)


def _digest(cells: MapCells, epoch: Epoch) -> bytes:
    """Return eight bytes that no other map has, and not this one in another epoch."""
    geometry = struct.pack('<2I4d42s', *cells.values.shape, cells.resolution, *cells.T_frame_grid,
                           str(epoch).encode())
    return blake2b(np.ascontiguousarray(cells.values).data, digest_size=8, person=b'map',
                   salt=blake2b(geometry, digest_size=16).digest()).digest()


def _parse(message: bytes, max_cells: int) -> Header:
    """Read and check a header; ValueError on what no map can have."""
    if (not HEADER.size < len(message) <= HEADER.size + 2 * max_cells
            or message[:len(KEY)] not in (KEY, CHANGE)):
        raise ValueError(f'{len(message)} bytes are no map message')
    header = Header(*HEADER.unpack_from(message))
    if not 0 < header.rows * header.columns <= max_cells:
        raise ValueError(f'map of {header.columns} x {header.rows} cells: 0, or over {max_cells}')
    if header.row + header.height > header.rows or header.column + header.width > header.columns:
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
    if _digest(cells, _epoch(header.epoch)) != header.digest:
        raise ValueError('map message does not give the map that it was made of')
    return cells
