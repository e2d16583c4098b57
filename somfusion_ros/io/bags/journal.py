# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Newest messages of a sqlite3 bag that are in its journal still (`.db3-wal`).

A recorder that was killed leaves them there (https://sqlite.org/wal.html), and so does a copy that
was made while it recorded. The library reads the database alone.
"""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
import shutil
import sqlite3

WAL = '-wal'


def in_journals(files: Sequence[Path]) -> list[Path]:
    """Return the files that have messages in a journal beside them."""
    journals = [(file, file.with_name(file.name + WAL)) for file in files]
    return [file for file, wal in journals if wal.exists() and wal.stat().st_size]


def merged(files: Sequence[Path], folder: Path) -> list[Path]:
    """Return files with their journals in them: of those that have one, a copy in a folder."""
    found, left = [], in_journals(files)
    for file in files:
        if file in left:
            target = folder / file.name
            for name in (file.name, file.name + WAL):
                shutil.copyfile(file.with_name(name), folder / name)
            with closing(sqlite3.connect(target)) as base:
                base.execute('PRAGMA wal_checkpoint(TRUNCATE)')
            file = target
        found.append(file)
    return found
