# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 without an index, with a wrong one, and of the format before chunks."""

from collections.abc import Callable
from pathlib import Path
import struct

import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.log import BagError
from somfusion_ros.io.bags.reader import BagReader

STORE = get_typestore(Stores.ROS1_NOETIC)
WORD = 'std_msgs/msg/String'
COUNT = 40


def payload(number: int) -> bytes:
    """One message as ROS 1 has it."""
    return bytes(STORE.serialize_ros1(STORE.types[WORD](f'word {number}'), WORD))


def written(file: Path, compression: str = '') -> bytes:
    """Write a bag of many chunks; return its bytes."""
    bag = Writer(file)
    bag.chunk_threshold = 100
    if compression:
        bag.set_compression(Writer.CompressionFormat[compression])
    with bag:
        topic = bag.add_connection('/word', WORD, typestore=STORE)
        for number in range(COUNT):
            bag.write(topic, number, payload(number))
    return file.read_bytes()


def wrong_sizes(data: bytes) -> bytes:
    """Make the sizes of the indexes too large, as on machines with entries of 20 bytes."""
    at = 0
    while (at := data.find(b'op=\x04', at)) >= 0:
        start = data.rfind(b'ver=', 0, at + 60)
        begin = data.rfind(struct.pack('<I', 47), 0, min(start, at))
        size = begin + 4 + 47
        (told,) = struct.unpack_from('<I', data, size)
        data = data[:size] + struct.pack('<I', told // 12 * 20) + data[size + 4:]
        at = max(at, size) + 4
    return data


def header(**fields: bytes) -> bytes:
    """Return a header with its size."""
    parts = [name.encode() + b'=' + value for name, value in fields.items()]
    body = b''.join(struct.pack('<I', len(part)) + part for part in parts)
    return struct.pack('<I', len(body)) + body


def format_1_2() -> bytes:
    """Return a bag as it was before ROS 1.2: definitions and messages one after another."""
    def sized(data: bytes) -> bytes:
        return struct.pack('<I', len(data)) + data
    data = b'#ROSRECORD V1.2\n'
    data += header(op=b'\3', index_pos=struct.pack('<Q', 0)) + sized(b' ' * 9)
    data += header(op=b'\1', topic=b'/word', type=b'std_msgs/String', md5=b'0',
                   **{'def': b'string data\n'}) + sized(b'')
    for number in range(COUNT):
        data += header(op=b'\2', topic=b'/word', type=b'std_msgs/String', md5=b'0',
                       sec=struct.pack('<I', 0), nsec=struct.pack('<I', number)
                       ) + sized(payload(number))
    return data + header(op=b'\4', topic=b'/word', ver=struct.pack('<I', 0),
                         count=struct.pack('<I', 0)) + sized(b'')


CASES: dict[str, tuple[Callable[[Path], bytes], float]] = {
    'log.bag.active': (written, 1.0),
    'cut.bag': (lambda file: written(file)[:9000], 0.3),
    'packed.bag': (lambda file: written(file, 'LZ4')[:-400], 1.0),
    'packed_bz2.bag': (lambda file: written(file, 'BZ2')[:-400], 1.0),
    'sizes.bag': (lambda file: wrong_sizes(written(file)), 1.0),
    'old.bag': (lambda file: format_1_2(), 1.0)}


@pytest.mark.parametrize('name', CASES)
def test_is_read_in_order_and_said(name: str, tmp_path: Path) -> None:
    make, least = CASES[name]
    (tmp_path / name).write_bytes(make(tmp_path / 'whole'))
    with BagReader(tmp_path / name) as bag:
        found = [message.data for _, _, message in bag.messages({'/word'})]
        assert bag.count('/word') == len(found)
        assert bag.span[0] == 0
        assert len(list(bag.serialized({'/word'}))) == len(found)
    assert found == [f'word {number}' for number in range(len(found))]
    assert len(found) >= least * COUNT
    assert 'rosbag reindex' in bag.notes[0]


@pytest.mark.parametrize('data', [b'#ROSBAG V2.0\n', b'#ROSBAG V2.0\n' + b'\xff' * 200, b'junk'])
def test_without_a_message_names_the_remedy(data: bytes, tmp_path: Path) -> None:
    (tmp_path / 'bad.bag').write_bytes(data)
    with pytest.raises(BagError, match='rosbag reindex'), BagReader(tmp_path / 'bad.bag'):
        pass
