# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The SLAM of one robot over its log, as fast as it goes."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
import time
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, compose
from somfusion_ros.grid import Grid
from somfusion_ros.io.bags.log import BagError, Log
from somfusion_ros.offline.history import History
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import Odometry, OdometryBuffer
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.trajectory import with_odometry

LATE_ODOMETRY = 0.5   # [s] scans this much after the last odometry are reached by its twist


@dataclass(frozen=True, eq=False)
class RobotRun:
    """
    What came out of one robot's log.

    grid in the robot's map frame; stamps [s] and poses T_map_base (M,), (M, 3) of every scan
    and of the odometry between them, and of the kept views (N,), (N, 3); odometry (K, 3) at the
    scans; counters by name; milliseconds per scan (K,); recorded and computing time [s]; the
    history where it was asked for.
    """

    log: Log
    grid: Grid
    stamps: Array
    poses: Array
    view_stamps: Array
    views: Array
    odometry: Array
    counters: dict[str, int]
    milliseconds: Array
    recorded: float
    seconds: float
    history: History | None = None


def run_robot(log: Log, config: SlamConfig | None = None,
              progress: Callable[[int], Any] = lambda n: None,
              history: History | None = None) -> RobotRun:
    """
    Run the SLAM over a log.

    progress is told the number of scans done since the last call; a history is filled.
    """
    slam = Slam(config)
    started, milliseconds, stamps, odometry = time.perf_counter(), [], [], []
    counters = {'scans_without_odometry': 0}
    buffer = OdometryBuffer(lambda name: _count(counters, name))
    for scan, odometry_then in paired(log, buffer, counters):
        before = time.perf_counter()
        step = slam.process(scan, odometry_then)
        buffer.lag = slam.odometry_lag
        milliseconds.append(1e3 * (time.perf_counter() - before))
        stamps.append(scan.stamp)
        odometry.append(odometry_then.pose)
        if history is not None:
            history.add(step, slam)
        progress(1)
    if not stamps:
        raise BagError(f'{log.path}: no scan has odometry at its time')
    while slam.work():
        pass
    if history is not None:
        history.end(slam)
    grid = slam.grid()
    seconds = time.perf_counter() - started
    view_stamps, views = slam.views()
    all_stamps, poses = dense(*slam.trajectory(), buffer)
    return RobotRun(log, grid, np.asarray(all_stamps), np.asarray(poses),
                    np.asarray(view_stamps), np.asarray(views),
                    np.asarray(odometry, dtype=float).reshape(-1, 3),
                    {**slam.counters, **counters, **log.counters}, np.asarray(milliseconds),
                    log.duration, seconds, history)


def dense(stamps: Array, poses: Array, buffer: OdometryBuffer) -> tuple[Array, Array]:
    """Add to the scans' stamps (n,) and poses (n, 3) those of the odometry that is still kept."""
    covered = np.flatnonzero([buffer.covers(t) for t in stamps])
    if not len(covered):
        return stamps, poses
    a, b = covered[0], covered[-1] + 1
    samples = [buffer.at(t) for t in buffer.stamps if buffer.covers(t)]
    dense = with_odometry(stamps[a:b], poses[a:b],
                          np.array([buffer.at(t).pose for t in stamps[a:b]]),
                          np.array([o.stamp for o in samples]),
                          np.array([o.pose for o in samples]))
    return (np.concatenate([stamps[:a], dense[0], stamps[b:]]),
            np.concatenate([poses[:a], dense[1], poses[b:]]))


def paired(log: Log, buffer: OdometryBuffer,
           counters: dict[str, int]) -> Iterator[tuple[Scan, Odometry]]:
    """Yield every scan with the odometry at its stamp; count the scans that have none."""
    waiting: deque[Scan] = deque()
    for record in log:
        if isinstance(record, Scan):
            waiting.append(record)
        else:
            buffer.add(record.stamp, record.pose, record.slip)
        while waiting and (buffer.covers(waiting[0].stamp, waiting[0].sweep)
                           or buffer.passed(waiting[0].stamp)):
            scan = waiting.popleft()
            yield from _with(scan, buffer.at(scan.stamp, scan.sweep), counters)
    for scan in waiting:   # no odometry came after them
        odometry = buffer.at(scan.stamp) or _extrapolated(buffer, scan.stamp)
        yield from _with(scan, odometry, counters)


def _with(scan: Scan, odometry: Odometry | None,
          counters: dict[str, int]) -> Iterator[tuple[Scan, Odometry]]:
    """Yield the pair if there is odometry, else count."""
    if odometry is None:
        _count(counters, 'scans_without_odometry')
    else:
        yield scan, odometry


def _extrapolated(buffer: OdometryBuffer, stamp: float) -> Odometry | None:
    """Odometry a little after the last sample, at constant twist; None if that is too late."""
    last = (None if buffer.latest is None else
            buffer.at(buffer.latest - max(buffer.lag, 0.0)))
    if last is None or not 0.0 <= stamp - last.stamp <= LATE_ODOMETRY:
        return None
    step = np.asarray(last.twist) * (stamp - last.stamp)
    return Odometry(stamp, compose(last.pose, step), last.twist, last.slip)


def _count(counters: dict[str, int], name: str) -> None:
    """Count one more."""
    counters[name] = counters.get(name, 0) + 1
