# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One way to open every kind of bag, with one kind of error."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

SUFFIXES = ('.mcap', '.db3', '.bag')


class BagError(ValueError):
    """A bag cannot be used; one line that names it and what is wrong."""


class BagReader:
    """A bag, open; a context manager. Every failure inside the bag becomes a BagError."""

    def __init__(self, path: str | Path) -> None:
        self.path = _resolve(Path(path))
        self._reader: AnyReader | None = None
        self.notes: list[str] = []

    def __enter__(self) -> 'BagReader':
        try:
            reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
        except Exception as error:   # the library raises many kinds on a damaged file
            raise self.error(f'not a readable bag ({_one_line(error)})') from error
        self._reader = reader
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._open.close()
        except Exception:   # a damaged file may fail again while it is closed
            pass

    @property
    def _open(self) -> AnyReader:
        """The bag while it is open."""
        if self._reader is None:
            raise self.error('is not open')
        return self._reader

    def error(self, what: str) -> BagError:
        """Make the error that names this bag."""
        return BagError(f'{self.path}: {what}')

    @property
    def duration(self) -> float:
        """Recorded time [s]."""
        return max(self._open.duration, 0) * 1e-9

    def topics(self, *msgtypes: str) -> list[str]:
        """Names of the topics of these types that hold messages."""
        return sorted({c.topic for c in self._open.connections
                       if c.msgtype in msgtypes and c.msgcount != 0})

    def count(self, topic: str) -> int:
        """Count the messages of a topic."""
        return sum(c.msgcount for c in self._open.connections if c.topic == topic)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, float, Any]]:
        """Yield topic, time of recording [s] and message of these topics."""
        connections = [c for c in self._open.connections if c.topic in topics]
        if not connections:
            return
        source = self._open.messages(connections=connections)
        while True:
            try:
                connection, nanoseconds, raw = next(source)
                message = self._open.deserialize(raw, connection.msgtype)
            except StopIteration:
                return
            except Exception as error:   # the library raises many kinds on a damaged file
                raise self.error(f'damaged or truncated ({_one_line(error)})') from error
            yield connection.topic, nanoseconds * 1e-9, message

    def first(self, topic: str) -> Any:
        """Return the first message of a topic."""
        for _, _, message in self.messages({topic}):
            return message
        raise self.error(f'topic {topic} holds no messages')


def _resolve(path: Path) -> Path:
    """Find the bag that a path means; BagError if there is none."""
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    if path.is_file():
        if path.name == 'metadata.yaml':
            return path.parent
        if path.suffix not in SUFFIXES:
            raise BagError(f'{path}: not a bag (expected a rosbag2 folder, {", ".join(SUFFIXES)})')
        if path.stat().st_size == 0:
            raise BagError(f'{path}: empty file')
        return path
    for folder in (path, path / 'bag'):
        if (folder / 'metadata.yaml').exists():
            return folder
        files = [f for f in folder.glob('*') if f.suffix in SUFFIXES]
        if len(files) == 1:   # a recording that was cut off has no metadata
            return files[0]
    raise BagError(f'{path}: not a bag (no metadata.yaml and no single bag file in this folder)')


def _one_line(error: Exception) -> str:
    """Give the reason of an error as one short line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    return text if len(text) <= 160 else text[:157] + '...'
