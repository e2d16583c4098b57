# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that are the old ones or the new ones, but never half of either."""

from collections.abc import Callable, Mapping
from contextlib import suppress
import os
from pathlib import Path
from typing import BinaryIO, cast

Opener = Callable[[Path, str], BinaryIO]


def open_file(path: Path, mode: str) -> BinaryIO:
    """Open a file of bytes."""
    return cast(BinaryIO, path.open(mode))


def write_text(path: Path, text: str) -> None:
    """Write or replace a file of text (UTF-8) in one step; OSError leaves it as it was."""
    write_files({path: text.encode()})


def write_files(files: Mapping[Path, bytes], opened: Opener = open_file) -> None:
    """
    Write or replace files that belong together, in the order given.

    All are on the disk, under other names beside their own, before the first of them takes its
    name: a full disk leaves all as they were, and a crash every single one whole. OSError, which
    names the file, is raised where one cannot be written.

    files : content by path; a link is followed, so that it stays one
    opened : what opens the files, so that a simulated disk can fail
    """
    drafts = {_draft(path): path for path in files}
    try:
        for draft, path in drafts.items():
            with opened(draft, 'wb') as file:
                file.write(files[path])
                file.flush()
                os.fsync(file.fileno())
        for draft, path in drafts.items():
            os.replace(draft, path.resolve())
    except OSError as error:
        for draft in drafts:
            with suppress(OSError):
                draft.unlink()
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _draft(path: Path) -> Path:
    """Return the name of an unfinished file, which no other process uses."""
    path = path.resolve()
    return path.with_name(f'.{path.name}.{os.getpid()}.new')
