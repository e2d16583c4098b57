# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the player plays of a bag: scans, odometry, joint states, a gyroscope and fixed transforms.

All is played as the bytes that were recorded. Where there are no laser scans, the first kind that
is there of those that can stand for them is played as `scan`: echoes, else clouds.

Several bags are played by one clock. Those that were recorded together keep their times; others
are shifted, with the stamps in their messages, to begin with the first one.
"""

from collections.abc import Iterator, Sequence
import heapq
from itertools import repeat
from pathlib import Path
import struct
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.files import BagError, resolve
from somfusion_ros.io.bags.topics import CLOUD, IMU, JOINTS, ODOMETRY, SCANS as LASERS

SCANS = (*LASERS, CLOUD)
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
USUAL_NAMES = {**dict.fromkeys(LASERS, 'scan'), CLOUD: 'points', ODOMETRY: 'odom',
               JOINTS: 'joint_states'}
STAMP = struct.Struct('<iI')   # seconds and nanoseconds of a header, behind CDR's own four bytes
STAMP_OFFSET = 4
CLOCKS_AGREE = 10 ** 9         # [ns] by which stamps may differ from the times of recording


class Record(NamedTuple):
    """One message: time of recording [ns], its type, its CDR bytes."""

    time: int
    msgtype: str
    data: bytes


def open_bag(path: str | Path) -> AnyReader:
    """
    Make a reader for a rosbag1 or rosbag2 (sqlite3, mcap) bag, or a folder with `bag` in it.

    BagError where there is none.
    """
    return AnyReader([resolve(Path(path))], default_typestore=get_typestore(Stores.ROS2_JAZZY))


class Recording:
    """
    One robot's bag, opened; ValueError with a sentence where it cannot be played.

    msgtypes: what it holds of what is played; scans: that of the scans; start, end: of the
    recording [ns]; shift [ns] is added to all times.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self.shift = 0
        try:
            self._reader = open_bag(path)
            self._reader.open()
        except BagError:
            raise
        except Exception as error:   # the library raises many kinds on a damaged file
            raise ValueError(f'{path}: not a readable bag ({error})') from error
        self._ros1 = None if self._reader.is2 else get_typestore(Stores.ROS1_NOETIC)
        held = {c.msgtype for c in self._reader.connections}
        scans = next((kind for kind in SCANS if kind in held), None)
        if scans is None:
            raise ValueError(f'{path}: no laser scans to play (none of {", ".join(SCANS)})')
        self.scans: str = scans
        self._connections = [c for kind in (scans, ODOMETRY, JOINTS, IMU, TRANSFORMS)
                             for c in self._choose(kind)]
        self.msgtypes = {c.msgtype for c in self._connections}
        self.start, self.end = self._reader.start_time, self._reader.end_time

    def close(self) -> None:
        """Close the bag."""
        self._reader.close()

    def records(self) -> Iterator[Record]:
        """Yield the played messages in the order of recording, at shifted times."""
        lag = self._clock_difference()
        if self._connections:
            for connection, time, raw in self._reader.messages(connections=self._connections):
                data = bytes(self._ros1.ros1_to_cdr(raw, connection.msgtype)
                             if self._ros1 else raw)
                if connection.msgtype != TRANSFORMS and self.shift - lag:
                    data = restamped(data, self.shift - lag)
                yield Record(time + self.shift, connection.msgtype, data)

    def _choose(self, msgtype: str) -> list[Any]:
        """Choose the topic of a type; of the transforms only those that never change."""
        found = [c for c in self._reader.connections if c.msgtype == msgtype]
        if msgtype == TRANSFORMS:
            return [c for c in found if c.topic.endswith('tf_static')]
        topics = sorted({c.topic for c in found})
        if msgtype == IMU:
            return found if len(topics) == 1 else []   # which of several is the robot's?
        named = [t for t in topics if t.rpartition('/')[2] == USUAL_NAMES[msgtype]]
        chosen = next((few for few in (topics, named) if len(few) == 1), [])
        if topics and not chosen:
            raise ValueError(f'{self._path}: which of {", ".join(topics)} is to be played as '
                             f'{USUAL_NAMES[msgtype]}? Leave one of them in the bag')
        return [c for c in found if c.topic in chosen]

    def _clock_difference(self) -> int:
        """Return the stamps minus times of recording [ns]; 0 where both are of one clock."""
        scans = [c for c in self._connections if c.msgtype == self.scans]
        for connection, time, raw in self._reader.messages(connections=scans) if scans else ():
            data = bytes(self._ros1.ros1_to_cdr(raw, connection.msgtype) if self._ros1 else raw)
            seconds, nanoseconds = STAMP.unpack_from(data, STAMP_OFFSET)
            difference = seconds * 10 ** 9 + nanoseconds - time
            return difference if abs(difference) > CLOCKS_AGREE else 0
        return 0


def restamped(data: bytes, shift: int) -> bytes:
    """Move the stamp in the header of a serialized message by a shift [ns]."""
    seconds, nanoseconds = STAMP.unpack_from(data, STAMP_OFFSET)
    whole, rest = divmod(seconds * 10 ** 9 + nanoseconds + shift, 10 ** 9)
    changed = bytearray(data)
    STAMP.pack_into(changed, STAMP_OFFSET, whole, rest)
    return bytes(changed)


def align(recordings: Sequence[Recording]) -> None:
    """Shift recordings to begin with the first one, unless all were recorded together."""
    latest, earliest = max(r.start for r in recordings), min(r.end for r in recordings)
    for recording in recordings:
        recording.shift = 0 if latest < earliest else recordings[0].start - recording.start


def together(recordings: Sequence[Recording]) -> Iterator[tuple[int, Record]]:
    """Yield the records of all, each with the number of its recording, in the order of time."""
    return heapq.merge(*(zip(repeat(number), recording.records())
                         for number, recording in enumerate(recordings)),
                       key=lambda item: item[1].time)
