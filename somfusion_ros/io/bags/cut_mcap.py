# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages of mcap files that have no end: the recorder was killed, the disk was full.

Such a file lacks the summary at its end, and its last chunk is cut off; everything before can be
read in order (https://mcap.dev/spec).
"""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from pathlib import Path
import struct
from typing import Any, BinaryIO, NamedTuple

from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.compression import unpacked_chunk

MAGIC = b'\x89MCAP0\r\n'
SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x03, 0x04, 0x05, 0x06
LARGEST_RECORD = 2 ** 28   # [bytes]; recorders close a chunk after some megabytes


class Topic(NamedTuple):
    """A topic of the file: its name, its type, and how many messages it has."""

    topic: str
    msgtype: str
    msgcount: int


class CutMcap:
    """Reads mcap files up to where each ends, in the way of `rosbags.highlevel.AnyReader`."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}
        counts: Counter[tuple[str, str]] = Counter()
        first, last = 2 ** 63, 0
        for channel, stamp, _ in self._messages():
            counts[channel] += 1
            first, last = min(first, stamp), max(last, stamp)
        self.connections = [Topic(*channel, count) for channel, count in counts.items()]
        self.start_time, self.end_time = first, last
        self.duration = max(last - first, 0)

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    def deserialize(self, raw: Any, msgtype: str) -> Any:
        """Return a message of its bytes."""
        return self._store.deserialize_cdr(raw, msgtype)

    def messages(self, connections: Collection[Topic]) -> Iterator[tuple[Topic, int, bytes]]:
        """Yield topic, time of recording [ns] and bytes of the messages of some topics."""
        wanted = {(topic.topic, topic.msgtype): topic for topic in connections}
        for channel, stamp, raw in self._messages():
            if channel in wanted:
                yield wanted[channel], stamp, raw

    def _messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Yield topic and type, time [ns] and bytes of every message that is whole."""
        for path in self._paths:
            self._schemas.clear()
            self._channels.clear()
            with path.open('rb') as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise ValueError(f'{path.name} is not an mcap file')
                for kind, content in _records(file):
                    if kind != CHUNK:
                        yield from self._take(kind, content)
                        continue
                    for inner, part in _records(BytesIO(_unpacked(content))):
                        yield from self._take(inner, part)

    def _take(self, kind: int, content: bytes) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Learn schemas and channels; yield messages of which the channel is known."""
        if kind == SCHEMA:
            (number,) = struct.unpack_from('<H', content)
            self._schemas[number] = _text(content, 2)[0]
        elif kind == CHANNEL:
            number, schema = struct.unpack_from('<HH', content)
            self._channels[number] = (_text(content, 4)[0], self._schemas.get(schema, ''))
        elif kind == MESSAGE:
            number, _, stamp, _ = struct.unpack_from('<HIQQ', content)
            if number in self._channels:
                yield self._channels[number], stamp, content[22:]


def _records(file: BinaryIO | BytesIO) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each record; of a chunk that is cut off, what there is of it."""
    while len(head := file.read(9)) == 9:
        kind, size = head[0], struct.unpack('<Q', head[1:])[0]
        if size > LARGEST_RECORD:
            return
        content = file.read(size)
        if len(content) < size and kind != CHUNK:
            return
        yield kind, content


def _unpacked(chunk: bytes) -> bytes:
    """Return the records of a chunk, or as much as there is of them."""
    if len(chunk) < 32:
        return b''
    compression, at = _text(chunk, 28)
    return unpacked_chunk(chunk[at + 8:], compression, LARGEST_RECORD)


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Return the text at a place in a record, and the place after it."""
    (size,) = struct.unpack_from('<I', content, at)
    return content[at + 4:at + 4 + size].decode(errors='replace'), at + 4 + size
