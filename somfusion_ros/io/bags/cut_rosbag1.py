# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages of rosbag1 files whose index is missing, wrong, or of an old form.

A recording that was cut off has no index (`.bag.active`, a full disk). Some recorders of 2010 and
after wrote wrong sizes of the index's records, which ROS 1 does not look at. Before, files had no
chunks (format 1.2). The messages can be read in order in all of them
(http://wiki.ros.org/Bags/Format).
"""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from pathlib import Path
import struct
from typing import Any, BinaryIO, NamedTuple

from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from somfusion_ros.io.bags.compression import unpacked_chunk
from somfusion_ros.io.bags.cut_mcap import LARGEST_RECORD

MAGIC = (b'#ROSBAG V2.0\n', b'#ROSRECORD V1.2\n')
DEFINITION, MESSAGE, INDEX, CHUNK, CONNECTION = b'\1', b'\2', b'\4', b'\5', b'\7'
ENTRY = 12   # [bytes] of an index, whatever the record says
Header = dict[bytes, bytes]


class Topic(NamedTuple):
    """A topic of the file: its name, its type, and how many messages it has."""

    topic: str
    msgtype: str
    msgcount: int


class CutRosbag1:
    """Reads rosbag1 files in order, in the way of `rosbags.highlevel.AnyReader`."""

    is2 = False

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._types: Typesdict = {}
        self._topics: dict[bytes, tuple[str, str]] = {}
        counts: Counter[tuple[str, str]] = Counter()
        first, last = 2 ** 63, 0
        for topic, stamp, _ in self._messages():
            counts[topic] += 1
            first, last = min(first, stamp), max(last, stamp)
        self.connections = [Topic(*topic, count) for topic, count in counts.items()]
        self.start_time, self.end_time = first, last
        self.duration = max(last - first, 0)
        self._store = get_typestore(Stores.EMPTY)
        self._store.register({**get_typestore(Stores.ROS1_NOETIC).fielddefs, **self._types})

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    def deserialize(self, raw: Any, msgtype: str) -> Any:
        """Return a message of its bytes."""
        return self._store.deserialize_ros1(raw, msgtype)

    def messages(self, connections: Collection[Topic]) -> Iterator[tuple[Topic, int, bytes]]:
        """Yield topic, time of recording [ns] and bytes of the messages of some topics."""
        wanted = {(topic.topic, topic.msgtype): topic for topic in connections}
        for topic, stamp, raw in self._messages():
            if topic in wanted:
                yield wanted[topic], stamp, raw

    def _messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Yield topic and type, time [ns] and bytes of every message that is whole."""
        for path in self._paths:
            self._topics.clear()
            with path.open('rb') as file:
                if file.readline(64) not in MAGIC:
                    raise ValueError(f'{path.name} is not a rosbag1 file')
                for header, content in _records(file):
                    if header.get(b'op') != CHUNK:
                        yield from self._take(header, content)
                        continue
                    how = header.get(b'compression', b'').decode(errors='replace')
                    for inner, part in _records(BytesIO(
                            unpacked_chunk(content, how, LARGEST_RECORD))):
                        yield from self._take(inner, part)

    def _take(self, header: Header, content: bytes
              ) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Learn topics and types; yield messages of which the topic is known."""
        op = header.get(b'op')
        if op == CONNECTION:
            inner = _fields(content)
            self._learn(header[b'conn'], header[b'topic'], inner[b'type'],
                        inner[b'message_definition'])
        elif op == DEFINITION:
            self._learn(header[b'topic'], header[b'topic'], header[b'type'], header[b'def'])
        elif op == MESSAGE:
            topic = self._topics.get(header.get(b'conn', header.get(b'topic', b'')))
            if topic is not None:
                seconds, nanoseconds = (
                    struct.unpack('<II', header[b'time']) if b'time' in header else
                    struct.unpack('<II', header[b'sec'] + header[b'nsec']))
                yield topic, seconds * 10 ** 9 + nanoseconds, content

    def _learn(self, key: bytes, topic: bytes, kind: bytes, definition: bytes) -> None:
        """Keep the name and the type of a topic."""
        package, _, name = kind.decode(errors='replace').rpartition('/')
        msgtype = f'{package.removesuffix("/msg")}/msg/{name}'
        self._topics[key] = topic.decode(errors='replace'), msgtype
        if msgtype not in self._types:
            self._types.update(get_types_from_msg(definition.decode(errors='replace'), msgtype))


def _records(file: BinaryIO | BytesIO) -> Iterator[tuple[Header, bytes]]:
    """Yield header and content of each record; of a chunk that is cut off, what there is of it."""
    while (size := _size(file)) and len(head := file.read(size)) == size:
        header, size = _fields(head), _size(file)
        if header.get(b'op') == INDEX and header.get(b'ver') == struct.pack('<I', 1):
            size = ENTRY * struct.unpack('<I', header[b'count'])[0]
        content = file.read(size)
        if len(content) < size and header.get(b'op') != CHUNK:
            return
        yield header, content


def _size(file: BinaryIO | BytesIO) -> int:
    """Return the size [bytes] of what comes next; 0 at the end, and where it cannot be."""
    told = file.read(4)
    size = int.from_bytes(told, 'little') if len(told) == 4 else 0
    return size if size < LARGEST_RECORD else 0


def _fields(data: bytes) -> Header:
    """Return the fields of a header by their names."""
    found, at = {}, 0
    while at + 4 <= len(data):
        size, = struct.unpack_from('<I', data, at)
        name, _, value = data[at + 4:at + 4 + size].partition(b'=')
        found[name] = value
        at += 4 + size
    return found
