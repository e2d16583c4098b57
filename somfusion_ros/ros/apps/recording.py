# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the player plays of a bag: scans, odometry, joint states, a gyroscope and fixed transforms.

Where the odometry is in /tf only, that transform of it is played. All else is played as the bytes
that were recorded; the time of recording stands in for stamps of 0. Where there are no laser
scans, the first kind that is there of those that can stand for them is played as `scan`: echoes,
else clouds.

Several bags are played by one clock. Those that were recorded together keep their times; others
are shifted, with the stamps in their messages, to begin with the first one.
"""

from collections.abc import Iterator, Sequence
import heapq
from itertools import repeat
from pathlib import Path
import struct
from typing import Any, NamedTuple

from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.bags.topics import CLOUD, IMU, JOINTS, ODOMETRY, SCANS as LASERS
from somfusion_ros.io.bags.transforms import odometry_frames
from somfusion_ros.io.frame_names import plain

SCANS = (*LASERS, CLOUD)
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
ODOMETRY_IN_TF = 'odometry in TFMessage'   # stands for a type
STORE = get_typestore(Stores.ROS2_JAZZY)
USUAL_NAMES = {**dict.fromkeys(LASERS, 'scan'), CLOUD: 'points', ODOMETRY: 'odom',
               JOINTS: 'joint_states'}
OPTIONS = {'--scan-topic': SCANS, '--odom-topic': (ODOMETRY,)}     # of the player
STAMP = struct.Struct('<iI')   # seconds and nanoseconds of a header, behind CDR's own four bytes
STAMP_OFFSET = 4
CLOCKS_AGREE = 10 ** 9         # [ns] by which stamps may differ from the times of recording


class Record(NamedTuple):
    """One message: time of recording [ns], its type or ODOMETRY_IN_TF, its CDR bytes."""

    time: int
    msgtype: str
    data: bytes


class Recording:
    """
    One robot's bag, opened; ValueError with a sentence where it cannot be played.

    msgtypes: what it holds of what is played; scans: that of the scans; start, end: of the
    recording [ns]; shift [ns] is added to all times; notes: sentences on what was mended. The
    topics of scans and odometry are found, unless they are named.
    """

    def __init__(self, path: str | Path, scan_topic: str | None = None,
                 odom_topic: str | None = None) -> None:
        self._path = path
        self.shift = 0
        self._bag = BagReader(path)
        self._bag.__enter__()
        self._types = self._bag.types()
        named = [*self._named(scan_topic, SCANS, 'laser scans'),
                 *self._named(odom_topic, (ODOMETRY,), 'odometry')]
        kinds = [kind for kind in SCANS if kind in self._types.values()]
        if not kinds:
            raise ValueError(f'{path}: no laser scans to play (none of {", ".join(SCANS)})')
        self.scans = next((self._types[topic] for topic in named
                           if self._types[topic] in SCANS), kinds[0])
        self._topics = {topic: kind for kind in (self.scans, ODOMETRY, JOINTS, IMU, TRANSFORMS)
                        for topic in self._choose(kind, named)}
        self.notes = self._bag.notes
        self._frames = ('', '')     # of the odometry, where that is in /tf
        if not {ODOMETRY, JOINTS} & set(self._topics.values()):
            self._look_in_transforms()
        self.msgtypes = set(self._topics.values())
        self.start, self.end = self._bag.span

    def close(self) -> None:
        """Close the bag."""
        self._bag.__exit__()

    def records(self) -> Iterator[Record]:
        """Yield the played messages in the order of recording, at shifted times."""
        lag = self._clock_difference()
        for topic, time, data in self._bag.serialized(self._topics):
            msgtype = self._topics[topic]
            if msgtype == ODOMETRY_IN_TF:
                data = self._odometry_of(data, self.shift - lag)
            elif msgtype != TRANSFORMS and not any(STAMP.unpack_from(data, STAMP_OFFSET)):
                data = restamped(data, time + self.shift)
            elif msgtype != TRANSFORMS and self.shift - lag:
                data = restamped(data, self.shift - lag)
            if data:
                yield Record(time + self.shift, msgtype, data)

    def _named(self, wanted: str | None, kinds: Sequence[str], what: str) -> list[str]:
        """Return the topic of a name, with or without its first slash; [] if none is wanted."""
        if wanted is None:
            return []
        found = sorted(topic for topic, kind in self._types.items() if kind in kinds)
        named = [topic for topic in found if topic.strip('/') == wanted.strip('/')]
        if not named:
            raise ValueError(f'{self._path}: no {what} on topic {wanted} (found: '
                             f'{", ".join(found) or "none"})')
        return named

    def _choose(self, msgtype: str, wanted: Sequence[str]) -> list[str]:
        """Choose the topic of a type; of the transforms only those that never change."""
        topics = sorted(topic for topic, kind in self._types.items() if kind == msgtype)
        asked = [topic for topic in topics if topic in wanted]
        if asked:
            return asked
        if msgtype == TRANSFORMS:
            return [topic for topic in topics if topic.endswith('tf_static')]
        if msgtype == IMU:
            return topics if len(topics) == 1 else []   # which of several is the robot's?
        named = [t for t in topics if t.rpartition('/')[2] == USUAL_NAMES[msgtype]]
        chosen = next((few for few in (topics, named) if len(few) == 1), [])
        if topics and not chosen:
            hint = next((f'Name it by {name}' for name, kinds in OPTIONS.items()
                         if msgtype in kinds), 'Leave one of them in the bag')
            raise ValueError(f'{self._path}: which of {", ".join(topics)} is to be played as '
                             f'{USUAL_NAMES[msgtype]}? {hint}')
        return chosen

    def _look_in_transforms(self) -> None:
        """Choose the transform that is odometry; note where there is none."""
        found = odometry_frames(self._bag)
        if found is not None and self._types[found[0]] == TRANSFORMS:
            self._topics[found[0]], self._frames = ODOMETRY_IN_TF, found[1]
        else:
            self.notes.append(f'{self._path}: holds no odometry to play: slam_node needs '
                              'odometry_source: none')

    def _odometry_of(self, data: bytes, shift: int) -> bytes:
        """Return a message with the transform alone that is odometry, shifted; b'' without it."""
        message: Any = STORE.deserialize_cdr(data, TRANSFORMS)
        kept = [item for item in message.transforms if self._frames == (
            plain(item.header.frame_id), plain(item.child_frame_id))]
        for item in kept:
            stamp = item.header.stamp
            stamp.sec, stamp.nanosec = divmod(
                stamp.sec * 10 ** 9 + stamp.nanosec + shift, 10 ** 9)
        message.transforms = kept
        return bytes(STORE.serialize_cdr(message, TRANSFORMS)) if kept else b''

    def _clock_difference(self) -> int:
        """Return the stamps minus times of recording [ns]; 0 where both are of one clock."""
        scans = [topic for topic, kind in self._topics.items() if kind == self.scans]
        for _, time, data in self._bag.serialized(scans):
            seconds, nanoseconds = STAMP.unpack_from(data, STAMP_OFFSET)
            if not seconds and not nanoseconds:
                self.notes.append(f'{self._path}: messages_without_stamp: the time of recording '
                                  'is used')
                return 0
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
