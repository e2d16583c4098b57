# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One way to open every kind of bag, with one kind of error."""

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.compression import unpacked, unpacked_message
from somfusion_ros.io.bags.cut_mcap import CutMcap
from somfusion_ros.io.bags.cut_rosbag1 import CutRosbag1
from somfusion_ros.io.bags.files import BagError, kind, resolve, storage_files
from somfusion_ros.io.bags.journal import in_journals, merged
from somfusion_ros.io.errors import reason_of

__all__ = ['BagError', 'BagReader']
REMEDIES = {'.mcap': 'mcap recover', '.db3': 'ros2 bag reindex, or sqlite3 .recover',
            '.bag': 'rosbag reindex', '': 'ros2 bag reindex'}


class BagReader:
    """
    A bag, open; a context manager. Every failure inside the bag becomes a BagError.

    Where the metadata cannot be used, the files beside it are read; a file that is cut off or
    damaged is read as far as it goes. notes: sentences on what was done so.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = resolve(Path(path))
        self.notes: list[str] = []
        self._reader: Any = None
        self._folder: TemporaryDirectory[str] | None = None

    def __enter__(self) -> 'BagReader':
        ways: list[Callable[[], Any]] = [self._open_folder] * (
            self.path.is_dir() and (self.path / 'metadata.yaml').exists()
            and not in_journals(storage_files(self.path)))
        errors: list[Exception] = []
        for way in [*ways, self._open_files, self._open_cut]:
            try:
                self._reader = way()
                if way == self._open_cut:
                    self._note('cut off, or without an index that can be used '
                               f'({reason_of(errors[-1])}): it is read as far as it goes; '
                               f'{self._remedy()} may bring more')
                elif errors:
                    self._note(f'metadata.yaml cannot be used ({reason_of(errors[0])}): the files '
                               'beside it are read')
                return self
            except Exception as error:   # the library raises many kinds on a damaged file
                errors.append(error)
        self.__exit__()
        raise self.error(f'not a readable bag ({reason_of(errors[0])}); '
                         f'{self._remedy()} may help') from errors[0]

    def __exit__(self, *_: object) -> None:
        try:
            if self._reader is not None:
                self._reader.close()
        except Exception:   # a damaged file may fail again while it is closed
            pass
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def error(self, what: str) -> BagError:
        """Make the error that names this bag."""
        return BagError(f'{self.path}: {what}')

    @property
    def duration(self) -> float:
        """Recorded time [s]."""
        return float(max(self._reader.duration, 0) * 1e-9)

    def topics(self, *msgtypes: str) -> list[str]:
        """Return the names of the topics of these types that hold messages."""
        return sorted({c.topic for c in self._reader.connections
                       if c.msgtype in msgtypes and c.msgcount != 0})

    def types(self) -> dict[str, str]:
        """Return the type of every topic that holds messages."""
        return {c.topic: c.msgtype for c in self._reader.connections if c.msgcount != 0}

    def count(self, topic: str) -> int:
        """Count the messages of a topic."""
        return sum(c.msgcount for c in self._reader.connections if c.topic == topic)

    @property
    def span(self) -> tuple[int, int]:
        """Times of recording [ns] of the first and the last message."""
        return self._reader.start_time, self._reader.end_time

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, float, Any]]:
        """Yield topic, time of recording [s] and message of these topics, up to any damage."""
        def deserialized(raw: bytes, msgtype: str) -> Any:
            return self._reader.deserialize(raw, msgtype)
        for connection, nanoseconds, message in self._read(topics, deserialized):
            yield connection.topic, nanoseconds * 1e-9, message

    def serialized(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time of recording [ns] and CDR bytes of these topics, up to any damage."""
        store = None if getattr(self._reader, 'is2', True) else get_typestore(Stores.ROS2_JAZZY)

        def cdr(raw: bytes, msgtype: str) -> bytes:
            if store is None:
                return bytes(raw)
            return bytes(store.serialize_cdr(self._reader.deserialize(raw, msgtype), msgtype))
        for connection, nanoseconds, data in self._read(topics, cdr):
            yield connection.topic, nanoseconds, data

    def _read(self, topics: Collection[str], make: Callable[[bytes, str], Any]
              ) -> Iterator[tuple[Any, int, Any]]:
        """Yield connection, time [ns] and what is made of bytes and type, up to any damage."""
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        source, read = self._reader.messages(connections=connections), 0
        while True:
            try:
                connection, nanoseconds, raw = next(source)
                message = make(unpacked_message(raw), connection.msgtype)
            except StopIteration:
                return
            except Exception as error:   # the library raises many kinds on a damaged file
                if not read:
                    raise self.error(f'damaged or truncated ({reason_of(error)}); '
                                     f'{self._remedy()} may help') from error
                self._note(f'read up to where it is damaged or truncated ({reason_of(error)}); '
                           f'{self._remedy()} may bring more')
                return
            read += 1
            yield connection, nanoseconds, message

    def first(self, topic: str) -> Any:
        """Return the first message of a topic."""
        for _, _, message in self.messages({topic}):
            return message
        raise self.error(f'topic {topic} holds no messages')

    def _open_folder(self) -> Any:
        """Open the bag by its metadata; an error where that leads to no message."""
        reader = _opened([self.path])
        counted = sum(c.msgcount for c in reader.connections)
        if not counted or next(reader.messages(connections=reader.connections), None) is None:
            reader.close()
            raise ValueError('metadata.yaml leads to no messages')
        return reader

    def _open_files(self) -> Any:
        """Open the files with the messages, without metadata."""
        files = storage_files(self.path) if self.path.is_dir() else [self.path]
        if not files:
            raise ValueError('no file with messages')
        self._folder = self._folder or TemporaryDirectory(prefix='somfusion_')
        folder = Path(self._folder.name)
        return _opened(unpacked(merged(files, folder), folder))

    def _open_cut(self) -> Any:
        """Open mcap files that have no end, and rosbag1 files whose index cannot be used."""
        files = storage_files(self.path) if self.path.is_dir() else [self.path]
        kinds = {kind(file) for file in files}
        if kinds not in ({'.mcap'}, {'.bag'}):
            raise ValueError('no files that can be read in order')
        self._folder = self._folder or TemporaryDirectory(prefix='somfusion_')
        paths = unpacked(files, Path(self._folder.name))
        reader = CutMcap(paths) if kinds == {'.mcap'} else CutRosbag1(paths)
        if not reader.connections:
            raise ValueError('no message in it is whole')
        return reader

    def _remedy(self) -> str:
        """Name the command that may bring more out of a damaged bag."""
        files = storage_files(self.path) if self.path.is_dir() else [self.path]
        suffix = kind(files[0]) if files else ''
        return REMEDIES.get(suffix, REMEDIES[''])

    def _note(self, what: str) -> None:
        """Keep a sentence, once."""
        note = f'{self.path}: {what}'
        if note not in self.notes:
            self.notes.append(note)


def _opened(paths: list[Path]) -> AnyReader:
    """Open files or a folder with the library."""
    reader = AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_JAZZY))
    reader.open()
    return reader
