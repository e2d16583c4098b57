# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a robot that is gone told of its path and its bonds, as one who heard it hands it on.

Who comes later then knows the same views and bonds as all others, and so draws the same map.
"""

from collections.abc import Iterable
import struct

SIZE = struct.Struct('<I')
MOST_BYTES = 64_000_000      # more than all that is kept of one robot


def encode_kept(batches: Iterable[bytes], bonds: bytes) -> bytes:
    """Pack batches of views, and the last bonds, as they came."""
    return b''.join(SIZE.pack(len(part)) + part for part in (bonds, *batches))


def decode_kept(data: bytes) -> tuple[list[bytes], bytes]:
    """Unpack batches of views, and bonds, empty where there are none; ValueError if damaged."""
    if len(data) > MOST_BYTES:
        raise ValueError(f'views of a robot that is gone take {len(data)} bytes')
    parts, at = [], 0
    while at < len(data):
        if at + SIZE.size > len(data):
            raise ValueError('views of a robot that is gone are cut short')
        size, = SIZE.unpack_from(data, at)
        at += SIZE.size + size
        if at > len(data):
            raise ValueError('views of a robot that is gone are cut short')
        parts.append(data[at - size:at])
    if not parts:
        raise ValueError('views of a robot that is gone are none')
    return parts[1:], parts[0]
