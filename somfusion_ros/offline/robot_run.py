# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The SLAM of one robot over its log, as fast as it goes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import time
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.grid import Grid
from somfusion_ros.io.bags.log import BagError, Log
from somfusion_ros.offline.beginning import Beginning
from somfusion_ros.offline.fault_log import FaultLog
from somfusion_ros.offline.history import History
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.lost import Found
from somfusion_ros.slam.motion import Odometry, OdometryBuffer
from somfusion_ros.slam.motion_guess import TurnRate
from somfusion_ros.slam.pairing import Pairing
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.start import Start
from somfusion_ros.slam.step import Step
from somfusion_ros.slam.trajectory import with_odometry
from somfusion_ros.team.joint_map import Held
from somfusion_ros.team.teller import tell
from somfusion_ros.team.view_facts import Facts

PATIENCE = 1e9         # [s] that a scan of a log waits: all of its odometry will come
MOST_WAITING = 20000   # scans of a log that may wait for odometry that was written later


@dataclass(frozen=True, eq=False)
class RobotRun:
    """
    What came out of one robot's log.

    grid in the robot's map frame; stamps [s] and poses T_map_base (M,), (M, 3) of every scan
    and of the odometry between them, and of the kept views (N,), (N, 3); the views that
    the robot hung on, and the facts that it tells of them; counters by name; notes: sentences on
    what was odd in the data; milliseconds per scan (K,); recorded and computing time [s]; the
    history where it was asked for; the checkpoint at the end of a run in a map that there was, and
    where the robot was found in that map, None where it was not.
    """

    log: Log
    grid: Grid
    stamps: Array
    poses: Array
    view_stamps: Array
    views: Array
    held: Held
    facts: Facts
    counters: dict[str, int]
    notes: list[str]
    milliseconds: Array
    recorded: float
    seconds: float
    history: History | None = None
    checkpoint: Checkpoint | None = None
    found: Found | None = None


def run_robot(log: Log, config: SlamConfig | None = None,
              progress: Callable[[int], Any] = lambda n: None,
              history: History | None = None, beginning: Beginning | None = None) -> RobotRun:
    """
    Run the SLAM over a log.

    progress is told the number of scans done since the last call; a history is filled. A
    beginning makes it go on in a map that there is; its checkpoint is then part of the result.
    """
    started, milliseconds = time.perf_counter(), []
    faults = FaultLog()
    if beginning is not None:
        beginning.counted(faults)
    session = Session(config or SlamConfig(), PATIENCE, faults, background=False,
                      capacity=MOST_WAITING,
                      checkpoint=beginning.checkpoint if beginning else None,
                      how=beginning.start if beginning else Start(),
                      odometry=log.odometry.kind != 'none')
    before = time.perf_counter()
    for step in steps_of(log, session):
        milliseconds.append(1e3 * (time.perf_counter() - before))
        if history is not None:
            history.add(step, session.slam)
        progress(1)
        before = time.perf_counter()
    slam = session.slam
    if not milliseconds:
        raise BagError(f'{log.path}: no scan has odometry at its time')
    if not len(slam.views()[0]):
        raise BagError(f'{log.path}: no scan could be used: {faults.main_cause()}')
    while slam.work():
        pass
    grid = slam.grid(anew=True)   # so that maps which a history drew on the way change nothing
    if history is not None:
        history.end(slam)
    seconds = time.perf_counter() - started
    view_stamps, views = slam.views()
    checkpoint = slam.checkpoint()
    all_stamps, poses = dense(*slam.driven(), session.pairing.odometry)
    return RobotRun(log, grid, np.asarray(all_stamps), np.asarray(poses),
                    np.asarray(view_stamps), np.asarray(views),
                    Held.of(checkpoint.trail), tell(checkpoint),
                    {**faults.counts, **slam.counters, **log.counters},
                    [*faults.notes(len(milliseconds)), *too_far(slam), *ended_lost(slam)],
                    np.asarray(milliseconds),
                    log.duration, seconds, history,
                    checkpoint if beginning and len(views) else None,
                    slam.found[0] if slam.found else None)


def too_far(slam: Slam) -> list[str]:
    """Return the sentence on scans that the map has no room for, if there are any."""
    count = slam.counters['map_scans_too_far']
    return [f'map_scans_too_far: {count} scans are not drawn, as the map would be too large with '
            'them: the odometry may have jumped, or the resolution is too fine'] if count else []


def ended_lost(slam: Slam) -> list[str]:
    """Return the sentence on a robot that was lost when its log ended, if it was."""
    stamps, _ = slam.driven()
    if not slam.lost or not len(stamps) or stamps[-1] >= slam.last_stamp:
        return []
    return [f'lost: where the robot was in the last {slam.last_stamp - stamps[-1]:.1f} s of the '
            f'log is not known, and nothing of them is in the map: {slam.lost}']


def dense(stamps: Array, poses: Array, buffer: OdometryBuffer) -> tuple[Array, Array]:
    """Add to the scans' stamps (n,) and poses (n, 3) those of the odometry that is still kept."""
    covered = np.flatnonzero([buffer.covers(t) for t in stamps])
    if not len(covered):
        return stamps, poses
    a, b = covered[0], covered[-1] + 1
    samples = [sample for t in buffer.stamps if (sample := buffer.at(t)) is not None]
    # Where it is covered at both ends it is covered between: the samples rise.
    at_scans = [sample.pose for t in stamps[a:b] if (sample := buffer.at(t)) is not None]
    dense = with_odometry(stamps[a:b], poses[a:b], np.array(at_scans),
                          np.array([o.stamp for o in samples]),
                          np.array([o.pose for o in samples]))
    return (np.concatenate([stamps[:a], dense[0], stamps[b:]]),
            np.concatenate([poses[:a], dense[1], poses[b:]]))


def steps_of(log: Log, session: Session) -> Iterator[Step]:
    """Yield what the SLAM makes of every scan of a log; time stands still, as all is there."""
    for record in log:
        feed(record, session)
        for _, step in session.steps(0.0):
            yield step
    for _, step in session.finish():
        yield step


def paired(log: Log, pairing: Pairing) -> Iterator[tuple[Scan, Odometry]]:
    """Yield every scan of a log with the odometry of its time, for another SLAM than ours."""
    for record in log:
        feed(record, pairing)
        while found := pairing.take(0.0):
            yield found.scan, found.odometry
    for found in pairing.finish():
        yield found.scan, found.odometry


def feed(record: Scan | Odometry | TurnRate, to: Session | Pairing) -> None:
    """Hand a record of a log on."""
    if isinstance(record, Scan):
        to.add_scan(record, None, 0.0)
    elif isinstance(record, TurnRate):
        to.add_turn_rate(record.stamp, record.rate)
    else:
        to.add_odometry(record.stamp, record.pose, record.slip)
