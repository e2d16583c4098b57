# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files that make up a bag: with metadata or without, split, compressed."""

from pathlib import Path
import re

from somfusion_ros.io.bags.compression import PACKED
from somfusion_ros.io.errors import InputError

ACTIVE = '.active'   # what rosbag adds to the name of a file that it is still writing
SUFFIXES = ('.mcap', '.db3', '.bag')


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
            raise BagError(f'{path}: not a bag (expected a rosbag2 folder, '
                           f'{", ".join(SUFFIXES)})')
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
    held = sorted([*(file.parent for file in path.glob('*/metadata.yaml')),
                   *(file.parents[1] for file in path.glob('*/bag/metadata.yaml'))])
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
    return kind(file) in SUFFIXES


def kind(file: Path) -> str:
    """Return the suffix of a file with messages: of one that is compressed, or was cut off."""
    return Path(file.name.removesuffix(PACKED).removesuffix(ACTIVE)).suffix


def split_name(file: Path) -> str:
    """Name of a file without the number that it has as part of a split recording."""
    return re.sub(r'_\d+$', '', file.name.removesuffix(PACKED).rpartition('.')[0])
