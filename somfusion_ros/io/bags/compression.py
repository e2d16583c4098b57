# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What recorders compress: whole files and messages (zstd), chunks (zstd, lz4, bz2)."""

import bz2
from collections.abc import Sequence
from pathlib import Path
import shutil
import sys
from typing import Any

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

PACKED = '.zstd'
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
MOST_UNPACKED = 64 * 2 ** 20   # [bytes] of one message


def unpacked(files: Sequence[Path], folder: Path) -> list[Path]:
    """Return files as they can be read: those that are compressed as a whole go into a folder."""
    found = []
    for file in files:
        if file.suffix != PACKED:
            found.append(file)
            continue
        target = folder / file.name.removesuffix(PACKED)
        with zstd.open(file, 'rb') as source, target.open('wb') as sink:
            shutil.copyfileobj(source, sink)
        found.append(target)
    return found


def unpacked_message(raw: Any) -> Any:
    """Return the bytes of a message, decompressed if need be; ValueError if too large."""
    if bytes(raw[:4]) != ZSTD_MAGIC:
        return raw
    found = zstd.ZstdDecompressor().decompress(bytes(raw), MOST_UNPACKED)
    if len(found) >= MOST_UNPACKED:
        raise ValueError(f'a compressed message holds over {MOST_UNPACKED} bytes')
    return found


def unpacked_chunk(data: bytes, compression: str, most: int) -> bytes:
    """
    Return what a chunk holds, at most so many bytes; of one that is cut off, what there is.

    compression: `zstd`, `lz4`, `bz2`, `none` or nothing, as mcap and rosbag1 name it; of another,
    and of damage, nothing.
    """
    try:
        if compression == 'zstd':
            return zstd.ZstdDecompressor().decompress(data, most)
        if compression == 'lz4':
            return bytes(LZ4FrameDecompressor().decompress(data, most))
        if compression == 'bz2':
            return bz2.BZ2Decompressor().decompress(data, most)
    except (OSError, RuntimeError, zstd.ZstdError):
        return b''
    return data if compression in ('', 'none') else b''
