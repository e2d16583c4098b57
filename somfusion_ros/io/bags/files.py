# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files that make up a bag: with metadata or without, split, compressed."""

from collections.abc import Sequence
from pathlib import Path
import re
import shutil
import sys
from typing import Any

from somfusion_ros.io.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

SUFFIXES = ('.mcap', '.db3', '.bag')
PACKED = '.zstd'
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
MOST_UNPACKED = 64 * 2 ** 20   # [bytes] of one message


class BagError(InputError):
    """A bag cannot be used; one line that names it and what is wrong."""


def resolve(path: Path) -> Path:
    """Find the folder or file of the bag that a path means; BagError if there is none."""
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    if path.is_file():
        if path.name == 'metadata.yaml':
            return path.parent
        if not is_storage(path):
            active = ' (a recording that was cut off: rosbag reindex)' if (
                path.suffix == '.active') else ''
            raise BagError(f'{path}: not a bag (expected a rosbag2 folder, '
                           f'{", ".join(SUFFIXES)}){active}')
        if path.stat().st_size == 0:
            raise BagError(f'{path}: empty file')
        return path
    for folder in (path, path / 'bag'):
        if (folder / 'metadata.yaml').exists():
            return folder
        files = storage_files(folder)
        if len(files) == 1:   # a recording that was cut off has no metadata
            return files[0]
        if files and len({split_name(file) for file in files}) == 1:
            return folder
    held = sorted(file.parent for file in path.glob('*/metadata.yaml'))
    hint = f'; name those that it holds, such as {held[0]}' if held else ''
    raise BagError(f'{path}: not a bag (no metadata.yaml, and no bag file, or files of several '
                   f'bags, in this folder){hint}')


def storage_files(folder: Path) -> list[Path]:
    """Return the files with messages in a folder, in the order in which they were recorded."""
    files = [file for file in folder.glob('*') if file.is_file() and is_storage(file)]
    return sorted(files, key=lambda file: [int(part) if part.isdigit() else part
                                           for part in re.split(r'(\d+)', file.name)])


def is_storage(file: Path) -> bool:
    """Tell whether a file holds messages, by its name."""
    return file.name.removesuffix(PACKED).endswith(SUFFIXES)


def split_name(file: Path) -> str:
    """Name of a file without the number that it has as part of a split recording."""
    return re.sub(r'_\d+$', '', file.name.removesuffix(PACKED).rpartition('.')[0])


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
