# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans and odometry out of a recorded log: rosbag1, or rosbag2 in sqlite3 or mcap.

The ranges are handed on as they were recorded: what 0 or a value above `range_max` means is
decided in one place for logs and live scans alike, `somfusion_ros.slam.scan`.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags import topics
from somfusion_ros.io.bags.odometry import converter
from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.bags.reader import BagError, BagReader
from somfusion_ros.io.bags.transforms import find_mount
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan

__all__ = ['BagError', 'BagOptions', 'Log', 'open_log']

REORDER_WINDOW = 64   # records among which one that was written late finds its place
HOLE = 1.5            # usual times between two records, that one is missing between


@dataclass
class Log:
    """
    One robot's log: iterate over it for Scan and Odometry records in the order of recording.

    counters holds what was left out and why; notes are sentences for the user; duration [s].
    """

    path: Path
    scan_topic: str
    odometry_topic: str
    odometry_source: str
    T_base_laser: Pose
    upside_down: bool
    scan_count: int
    duration: float
    options: BagOptions
    notes: list[str] = field(default_factory=list)
    counters: dict[str, int] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Scan | Odometry]:
        """Yield the records; BagError where the bag ends before its time."""
        self.counters.clear()
        return _in_order(self._records())

    def _records(self) -> Iterator[Scan | Odometry]:
        """Yield the records as they were written."""
        convert = converter(self.odometry_source, self.options, self.path)
        with BagReader(self.path) as reader:
            for topic, log_time, message in reader.messages({self.scan_topic,
                                                             self.odometry_topic}):
                if topic == self.scan_topic:
                    yield self._scan(message, log_time)
                else:
                    odometry = convert(message, log_time)
                    if odometry is not None and self._usable(odometry):
                        yield odometry

    def _scan(self, message: Any, log_time: float) -> Scan:
        """Convert a LaserScan; one seen upside down turns the other way round."""
        turn = -1.0 if self.upside_down else 1.0
        with np.errstate(invalid='ignore'):   # a damaged file may hold signalling NaN
            ranges = np.asarray(message.ranges, dtype=float)
        return Scan(
            stamp=topics.stamp(message.header, log_time), ranges=ranges,
            angle_min=turn * float(message.angle_min),
            angle_increment=turn * float(message.angle_increment),
            range_min=float(message.range_min), range_max=float(message.range_max),
            time_increment=float(message.time_increment), T_base_laser=self.T_base_laser)

    def _usable(self, odometry: Odometry) -> bool:
        """Tell whether odometry is finite, and count it otherwise."""
        usable = bool(np.isfinite(odometry.pose).all())
        if not usable:
            self.counters['odometry_not_finite'] = self.counters.get('odometry_not_finite', 0) + 1
        return usable


def open_log(path: str | Path, options: BagOptions | None = None) -> Log:
    """
    Find out what a bag holds.

    Parameters
    ----------
    path : a rosbag2 folder, a single .mcap, .db3 or .bag file, or a folder with `bag` in it
    options : what to use; default: everything as found

    Raises
    ------
    BagError : one line that names the bag and what is wrong with it

    """
    options = options or BagOptions()
    with BagReader(path) as reader:
        scan_topic = topics.choose_scan_topic(reader, options.scan_topic)
        scan = reader.first(scan_topic)
        source, topic = topics.choose_odometry(reader, options)
        base_frame = topics.base_frame(reader, source, topic)
        log = Log(path=reader.path, scan_topic=scan_topic, odometry_topic=topic,
                  odometry_source=source, T_base_laser=Pose(), upside_down=False,
                  scan_count=reader.count(scan_topic), duration=reader.duration,
                  options=options)
        if options.laser_pose is not None:
            return replace(log, T_base_laser=Pose.from_array(options.laser_pose))
        mount = find_mount(reader, base_frame, topics.plain(scan.header.frame_id))
        if mount is None:
            return replace(log, notes=[
                f'{reader.path}: no transform from {base_frame} to '
                f'{topics.plain(scan.header.frame_id)!r}; the laser is taken to sit in '
                f'{base_frame} (give --laser-pose)'])
        return replace(log, T_base_laser=mount.T_base_laser, upside_down=mount.upside_down)


def _in_order(records: Iterator[Scan | Odometry]) -> Iterator[Scan | Odometry]:
    """
    Put records that were written late back among those of their kind.

    A late record fills a hole that the stamps before it left; one that fills none was stamped by a
    clock that was set back, which the SLAM has to see.
    """
    window: deque[Scan | Odometry] = deque()
    for record in records:
        place = _place_of(record, window)
        window.insert(len(window) if place is None else place, record)
        if len(window) > REORDER_WINDOW:
            yield window.popleft()
    yield from window


def _place_of(record: Scan | Odometry, window: deque[Scan | Odometry]) -> int | None:
    """Index in the window of the hole that a late record fills; None where it is not late."""
    same = [i for i, other in enumerate(window) if type(other) is type(record)]
    if not same or not record.stamp < window[same[-1]].stamp:
        return None
    stamps = np.array([window[i].stamp for i in same])
    after = int(np.searchsorted(stamps, record.stamp))
    if after == 0 or (np.diff(stamps) < 0.0).any():
        return None
    hole, usual = stamps[after] - stamps[after - 1], np.median(np.diff(stamps))
    return same[after] if hole > HOLE * usual else None
