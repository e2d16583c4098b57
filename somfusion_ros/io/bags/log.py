# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans and odometry out of a recorded log: rosbag1, or rosbag2 in sqlite3 or mcap.

The ranges are handed on as they were recorded: what 0 or a value above `range_max` means is
decided in one place for logs and live scans alike, `somfusion_ros.slam.laser`.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags.odometry import converter, turn_rate
from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.bags.reader import BagError, BagReader
from somfusion_ros.io.bags.topics import (choose_odometry, choose_scan_topics, find_robots,
                                          is_stamped, laser_frames, NO_ODOMETRY,
                                          OdometrySource, stamp)
from somfusion_ros.io.bags.transforms import difference, find_mounts, Mounts
from somfusion_ros.io.frame_names import plain
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.io.scan_messages import LASERS_APART, scan_from
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.motion_guess import TurnRate
from somfusion_ros.slam.scan import Scan

__all__ = ['BagError', 'BagOptions', 'Log', 'open_log', 'robots_in']

Record = Scan | Odometry | TurnRate
REORDER_WINDOW = 64   # records among which one that was written late finds its place
HOLE = 1.5            # usual times between two records, that one is missing between


@dataclass
class Log:
    """
    One robot's log: iterate over it for Scan and Odometry records in the order of recording.

    lasers: the mounts of each laser by the topic of its scans; odometry: where it comes from;
    counters holds what was left out and why; notes are sentences for the user; duration [s].
    """

    path: Path
    lasers: dict[str, Mounts]
    odometry: OdometrySource
    scan_count: int
    duration: float
    options: BagOptions
    notes: list[str] = field(default_factory=list)
    counters: dict[str, int] = field(default_factory=dict)

    @property
    def scan_topic(self) -> str:
        """Topic of the scans; of several lasers all topics, with commas between."""
        return ', '.join(self.lasers)

    @property
    def odometry_source(self) -> str:
        """Kind of odometry: odom, encoders, tf or none."""
        return self.odometry.kind

    @property
    def odometry_topic(self) -> str:
        """Topic of the odometry."""
        return self.odometry.topic

    @property
    def T_base_laser(self) -> Pose:
        """Mount of the first laser; the last one that it had."""
        return next(iter(self.lasers.values())).at(np.inf).T_base_laser

    @property
    def upside_down(self) -> bool:
        """Tell whether the first laser hangs upside down."""
        return next(iter(self.lasers.values())).at(np.inf).upside_down

    def __iter__(self) -> Iterator[Record]:
        """Yield the records; BagError where the bag ends before its time."""
        self.counters.clear()
        return _in_order(self._records())

    def _records(self) -> Iterator[Record]:
        """Yield the records as they were written."""
        convert = converter(self.odometry, self.options, self.path)
        topics = {*self.lasers, self.odometry.topic, self.odometry.gyro}
        apart = {topic: n * LASERS_APART for n, topic in enumerate(self.lasers)}
        with BagReader(self.path) as reader:
            for topic, log_time, message in reader.messages(topics):
                if not is_stamped(message):
                    self._count('messages_without_stamp', f'{topic} has stamps of 0: the time of '
                                'recording is used')
                if topic in self.lasers:
                    try:
                        yield scan_from(message, self.lasers[topic].at(log_time),
                                        stamp(message.header, log_time) + apart[topic], topic)
                    except ValueError as error:
                        self._count('scans_unusable', str(error))
                elif topic == self.odometry.gyro:
                    yield turn_rate(message, log_time)
                else:
                    record = convert(message, log_time)
                    if record is not None and self._usable(record):
                        yield record
            self.notes += [note for note in reader.notes if note not in self.notes]

    def _usable(self, record: Odometry) -> bool:
        """Tell whether odometry is finite, and count it otherwise."""
        usable = bool(np.isfinite(record.pose).all())
        if not usable:
            self._count('odometry_not_finite')
        return usable

    def _count(self, kind: str, reason: str = '') -> None:
        """Count what was left out, and note why at the first time."""
        self.counters[kind] = self.counters.get(kind, 0) + 1
        if reason and self.counters[kind] == 1:
            self.notes.append(f'{kind}: {reason}')


def open_log(path: str | Path, options: BagOptions | None = None) -> Log:
    """
    Find out what a bag holds of a robot.

    Parameters
    ----------
    path : path
        A rosbag2 folder, a single .mcap, .db3 or .bag file, or a folder with `bag` in it.
    options : BagOptions, optional
        What to use of it; by default everything as found.

    Returns
    -------
    Log
        Iterate over it for the scans and the odometry.

    Raises
    ------
    BagError
        In one line that names the bag and what is wrong with it.
    """
    options = options or BagOptions()
    with BagReader(path) as reader:
        topics = choose_scan_topics(reader, options)
        if len(topics) > 1 and options.laser_pose is not None:
            raise reader.error(f'several topics with laser scans: {", ".join(topics)}; '
                               '--laser-pose is the mount of one: name it by --scan-topic')
        odometry = choose_odometry(reader, options)
        notes: list[str] = []
        if odometry.kind == 'none' and options.odometry_source == 'auto':
            notes.append(f'{reader.path}: {NO_ODOMETRY}: it is mapped from the scans alone')
        if (options.wheel_radius or options.wheel_separation) and odometry.kind != 'encoders':
            notes.append(f'{reader.path}: the wheels are not used, as there is odometry of kind '
                         f'{odometry.kind}: for them give --odometry-source encoders')
        lasers = {topic: _mount_of(reader, topic, odometry.base_frame, options, notes)
                  for topic in topics}
        if len(topics) > 1 and any('is taken to sit' in note for note in notes):
            raise reader.error(f'several topics with laser scans: {", ".join(topics)}; name one '
                               'by --scan-topic, or record where each laser sits on /tf_static')
        return Log(path=reader.path, lasers=lasers, odometry=odometry,
                   scan_count=sum(map(reader.count, topics)), duration=reader.duration,
                   options=options, notes=[*reader.notes, *notes])


def robots_in(path: str | Path) -> list[str]:
    """Find the namespaces of the robots in a bag; [''] where it is one robot's."""
    with BagReader(path) as reader:
        return find_robots(reader)


def _mount_of(reader: BagReader, topic: str, base_frame: str, options: BagOptions,
              notes: list[str]) -> Mounts:
    """Find the mounts of the laser whose scans are on a topic, and note what is odd about it."""
    frame = plain(reader.first(topic).header.frame_id)
    if options.laser_pose is not None:
        given = Mount(Pose.from_array(options.laser_pose))
        differs = difference(reader, given, base_frame, frame, options.namespace)
        notes += [f'{reader.path}: {differs}'] if differs else []
        return Mounts(given)
    mounts, odd = find_mounts(reader, base_frame, frame, options.namespace,
                              {other for where, other in laser_frames(reader).items()
                               if where != topic})
    notes += odd
    if mounts is None:
        notes.append(f'{reader.path}: no transform from {base_frame} to {frame!r}; the laser is '
                     f'taken to sit in {base_frame} (give --laser-pose)')
    return mounts or Mounts(Mount(Pose()))


def _in_order(records: Iterator[Record]) -> Iterator[Record]:
    """
    Put records that were written late back among those of their kind.

    A late record fills a hole that the stamps before it left; one that fills none was stamped by a
    clock that was set back, which the SLAM has to see.
    """
    window: deque[Record] = deque()
    for record in records:
        place = _place_of(record, window)
        window.insert(len(window) if place is None else place, record)
        if len(window) > REORDER_WINDOW:
            yield window.popleft()
    yield from window


def _place_of(record: Record, window: deque[Record]) -> int | None:
    """Return the index of the hole that a late record fills; None where it is not late."""
    same = [i for i, other in enumerate(window) if type(other) is type(record)]
    if not same or not record.stamp < window[same[-1]].stamp:
        return None
    stamps = np.array([window[i].stamp for i in same])
    after = int(np.searchsorted(stamps, record.stamp))
    if after == 0 or (np.diff(stamps) < 0.0).any():
        return None
    hole, usual = stamps[after] - stamps[after - 1], np.median(np.diff(stamps))
    return same[after] if hole > HOLE * usual else None
