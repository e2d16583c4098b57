# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A file of records that is only appended to: a change costs what it weighs, damage stays in place.

Every record has a marker, a kind, a length and a checksum. A record that is damaged or torn is
skipped, and reading goes on at the next marker; whatever the damage, the rest is read. SQLite
would do the writing, but has no checksums: one flipped bit in an inner page loses a table.
"""

from collections.abc import Iterator, Mapping
import fcntl
import math
import os
from pathlib import Path
import struct
from types import TracebackType
from typing import BinaryIO
import zlib

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.whole_files import open_file, Opener, write_files

MARKER = b'\xf5SOMj\x01\r\n'           # begins every record; its sixth byte is the version
HEAD = struct.Struct('<8s4sII')        # marker, kind, length of the payload, checksum
LONGEST = 1 << 28                      # [bytes] of a payload; a longer one is damage
DAMAGED = (ValueError, KeyError, IndexError, TypeError, OverflowError, struct.error)


class JournalInUse(OSError):
    """Another process keeps its checkpoints in the same file."""


def packed(kind: str, arrays: Mapping[str, Array]) -> bytes:
    """Return a record of a kind (up to 4 letters) that holds arrays of numbers by name."""
    parts = []
    for name, array in arrays.items():
        array = np.asarray(array)
        array = array.astype(array.dtype.newbyteorder('<'), order='C', copy=False)
        label = f'{name} {array.dtype.str}'.encode()
        parts += [struct.pack('<BB', len(label), array.ndim), label,
                  struct.pack(f'<{array.ndim}I', *array.shape), array.tobytes()]
    payload, kind_name = b''.join(parts), kind.encode().ljust(4)
    checksum = zlib.crc32(kind_name + payload)
    return HEAD.pack(MARKER, kind_name, len(payload), checksum) + payload


def _unpacked(payload: bytes) -> dict[str, Array]:
    """Return the arrays of a payload by name; raise one of DAMAGED where it is none."""
    arrays, at = {}, 0
    while at < len(payload):
        length, dimensions = struct.unpack_from('<BB', payload, at)
        name, dtype = payload[at + 2:at + 2 + length].decode().split(' ')
        at += 2 + length
        shape = struct.unpack_from(f'<{dimensions}I', payload, at)
        at += 4 * dimensions
        count = math.prod(shape)
        arrays[name] = np.frombuffer(payload, dtype, count, at).reshape(shape).copy()
        at += arrays[name].nbytes
    return arrays


def records(data: bytes) -> Iterator[tuple[str, dict[str, Array]]]:
    """
    Yield kind and arrays of every sound record, in order.

    What is damaged is passed over; ('bad', {}) is yielded once for each stretch of it.
    """
    at = 0
    while at < len(data):
        start = data.find(MARKER, at)
        if start != at:
            yield 'bad', {}
        if start < 0:
            return
        at = start + len(MARKER)
        if start + HEAD.size > len(data):
            yield 'bad', {}
            return
        _, name, length, checksum = HEAD.unpack_from(data, start)
        payload = data[start + HEAD.size:start + HEAD.size + length]
        if length > LONGEST or len(payload) < length or zlib.crc32(name + payload) != checksum:
            continue     # to the next marker
        try:
            yield name.decode().strip(), _unpacked(payload)
        except DAMAGED:
            yield 'bad', {}
        at = start + HEAD.size + length


class Journal:
    """
    A journal that this process appends to; one process at a time.

    opened: what opens the file, so that a simulated disk can fail. Raises JournalInUse where
    another one has it.
    """

    def __init__(self, path: Path, opened: Opener = open_file) -> None:
        self.path, self._opened = path, opened
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = open(path.with_name(f'{path.name}.lock'), 'ab')
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise JournalInUse(f'{path} is in use by another process') from None
        self._file: BinaryIO | None = None

    def __enter__(self) -> 'Journal':
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Length [bytes] of the file; 0 where there is none."""
        return self.path.stat().st_size if self.path.exists() else 0

    def read(self) -> bytes:
        """Return what the file holds; FileNotFoundError where there is none."""
        return self.path.read_bytes()

    def append(self, data: bytes) -> None:
        """Append records, and wait until the disk has them; undo what it took where it is full."""
        if self._file is None:
            self._file = self._opened(self.path, 'ab')
        end = self._file.tell()
        try:
            self._file.write(data)
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError:
            self._close_file()
            os.truncate(self.path, end)
            raise

    def replace(self, data: bytes) -> None:
        """Replace the whole file in one step: it is the old one or the new, whatever happens."""
        self._close_file()
        write_files({self.path: data}, self._opened)

    def delete(self) -> None:
        """Delete the file."""
        self._close_file()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Let another process have the journal."""
        self._close_file()
        self._lock.close()

    def _close_file(self) -> None:
        """Close the file; what a full disk did not take is dropped."""
        if self._file is not None:
            try:
                self._file.close()
            except OSError:
                pass
            self._file = None
