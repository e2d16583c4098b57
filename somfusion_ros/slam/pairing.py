# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans paired with the odometry of their time, whatever order and whatever stamps they come with.

Live nodes and replays go through here alike. Nothing here knows a message or a clock.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.geometry import Array, between
from somfusion_ros.slam.arrived import Arrived
from somfusion_ros.slam.gyro import Gyro
from somfusion_ros.slam.laser import Laser, MOST_LASERS
from somfusion_ros.slam.motion import Odometry, OdometryBuffer
from somfusion_ros.slam.motion_guess import MotionGuess
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.scan_clock import ScanClock
from somfusion_ros.slam.scan_queue import MAX_WAITING, ScanQueue
from somfusion_ros.slam.stamps import Judgement, StampStream
from somfusion_ros.slam.standing_clock import StandingClock

CONTINUED_DISTANCE = 1.0   # [m] odometry that moved less than this across a jump of time goes on
CONTINUED_HEADING = 1.0    # [rad]
USUAL_PERIOD = 0.05        # [s] of odometry whose rate is not known yet
LATE = 1.0                 # [s] a stamp that lies this little before the last one is late
PATIENCE = 4.0             # timeouts that a scan may wait until its place in time is known


class Tagged(NamedTuple):
    """A scan, the tag that comes back with it, and when it arrived [s, steady clock]."""

    scan: Scan
    tag: Any
    arrived: float


class Paired(NamedTuple):
    """A scan, stamped in the time of the odometry, its tag, and the odometry then."""

    scan: Scan
    tag: Any
    odometry: Odometry


class Pairing:
    """
    Takes odometry and scans as they arrive, and yields scans with their odometry.

    Stray stamps are left out, and steps of the clocks are undone, so that what comes out has one
    time that only rises, until the odometry begins anew at an earlier time.

    Parameters
    ----------
    timeout : time [s] that a scan waits for its odometry
    count : called with the name of each fault, and its reason
    began_anew : called where time and odometry were both set back
    capacity : scans that may wait at once
    guess : what stands in for odometry; None where there is odometry

    """

    def __init__(self, timeout: float, count: Callable[..., None],
                 began_anew: Callable[[], None] = lambda: None,
                 capacity: int = MAX_WAITING, guess: MotionGuess | None = None) -> None:
        self._timeout, self._count, self._capacity = timeout, count, capacity
        self._began_anew, self._guess = began_anew, guess
        self.odometry = OdometryBuffer(count)
        self.gyro = Gyro(count, trusted=guess is not None)
        self._queue = ScanQueue(self.odometry, timeout, count, capacity)
        self._odometry_stamps = StampStream()
        self._scan_stamps: defaultdict[str, StampStream] = defaultdict(StampStream)
        self._odometry_clock = StandingClock('odometry', count)
        self._scan_clocks = defaultdict[str, StandingClock](lambda: StandingClock('scan', count))
        self._clock = ScanClock(count)
        self._newest_pose: Array | None = None
        self._messages = 0     # of odometry, whatever their stamps
        self._now = 0.0        # [s, steady clock] as it was told last
        self._lasers: dict[str, Laser] = {}

    def add_odometry(self, stamp: float, pose: Array, slip: Array | None = None) -> None:
        """Add T_odom_base (3,) at a stamp [s]."""
        self._messages += 1
        stamp = self._odometry_clock.mend(stamp, np.asarray(pose), self._now)
        self._add_odometry(self._odometry_stamps.add(stamp, (pose, slip)))

    def add_turn_rate(self, stamp: float, rate: float) -> None:
        """Take the turn rate [rad/s] of a gyroscope at a stamp [s]."""
        self.gyro.add(stamp + self._odometry_clock.shift + self._clock.odometry_shift, rate)

    def add_scan(self, scan: Scan, tag: Any, now: float) -> None:
        """Add a scan; now [s] is any steady time."""
        self._now = now
        if scan.laser not in self._lasers and len(self._lasers) < MOST_LASERS:
            self._lasers[scan.laser] = Laser(self._count)
        if scan.laser in self._lasers:
            scan = self._lasers[scan.laser].mend(scan)
        laser = scan.laser if scan.laser in self._lasers else ''
        stamp, stamps = self._scan_clocks[laser].mend(
            scan.stamp, scan.ranges, now), self._scan_stamps[laser]
        self._add_scans(stamps.add(stamp, Tagged(scan, tag, now)), stamps.last)

    def take(self, now: float) -> Paired | None:
        """Return the next scan that the odometry covers; None where there is none yet."""
        self._now = now if now < np.inf else self._now
        self._drop_undecided(now)
        if self._guess is not None:
            first = self._queue.first()
            return None if first is None else Paired(
                first[0], first[1], self.gyro.beside(self._guess.at(first[0].stamp)))
        self._queue.late = self._clock.lateness.is_due
        found = next(self._queue.ready(now), None)
        if found is None:
            return None
        (scan, tag), odometry = found
        return Paired(scan, tag, self.gyro.beside(odometry, self.odometry.lag))

    def finish(self) -> Iterator[Paired]:
        """Yield what still waits at the end of a log, with the odometry that there is."""
        self._add_odometry(self._odometry_stamps.flush())
        for stamps in self._scan_stamps.values():
            self._add_scans(stamps.flush(), stamps.last)
        self._wait(self._clock.undecided)
        self._clock.forget()
        while found := self.take(np.inf):
            yield found

    @property
    def odometry_late(self) -> float:
        """Time [s] by which the odometry comes late, where that is worth a word; else 0."""
        return self._clock.lateness.seconds

    @property
    def _newest_odometry(self) -> float:
        """Stamp [s] of the newest odometry; -inf before the first."""
        return -np.inf if self.odometry.latest is None else self.odometry.latest

    def _add_odometry(self, judged: Judgement) -> None:
        """Keep the odometry whose stamps are good, in a time that only rises."""
        self._count_stray('odometry', judged.stray, self._odometry_stamps.last)
        if judged.leap:
            self._count_leap('odometry', judged)
            if judged.leap < 0.0:
                self._set_back(judged)
            self._clock.leapt('odometry', judged.leap, self._newest_odometry)
        told = dict(judged.good)   # the last of one stamp, as what was held is stamped late
        for _ in judged.good[len(told):]:
            self._count('odometry_stamps_repeated', 'one has the stamp of the one before it')
        for stamp, (pose, slip) in told.items():
            if self.odometry.add(stamp + self._clock.odometry_shift, pose, slip):
                self._newest_pose = np.array(pose, dtype=float)
        self._place()

    def _add_scans(self, judged: Judgement, last: float) -> None:
        """Queue the scans whose stamps are good until their odometry comes."""
        self._count_stray('scan', judged.stray, last)
        if judged.leap:
            self._count_leap('scan', judged)
            if self._guess is not None and judged.leap < 0.0:
                self._clock.shift += USUAL_PERIOD - judged.leap
            self._clock.leapt('scan', judged.leap, self._newest_odometry)
        for stamp, tagged in judged.good:
            self._clock.add(Arrived(stamp, self._newest_odometry, tagged, tagged.arrived,
                                    self._messages, tagged.scan.laser),
                            self._odometry_stamps.period)
        self._place()

    def _place(self) -> None:
        """Queue the scans of which it is known where in time they belong."""
        placed = self._clock.place(self.odometry.covers, self._odometry_stamps.period)
        self.odometry.delay(*self._clock.missing())
        self._wait(placed)

    def _wait(self, scans: list[Arrived]) -> None:
        """Queue scans until their odometry comes."""
        for stamped in scans:
            (scan, tag, arrived), stamp = stamped.item, stamped.stamp + self._clock.shift
            self._queue.add(stamp, (replace(scan, stamp=stamp), tag), arrived, scan.sweep,
                            scan.laser)

    def _drop_undecided(self, now: float) -> None:
        """Drop scans of which it never came out where in time they belong."""
        undecided = self._clock.undecided
        while undecided and (len(undecided) > self._capacity or
                             now - undecided[0].item.arrived > PATIENCE * self._timeout):
            undecided.pop(0)
            self._count('scans_without_odometry', 'the time of the scans leapt, and no odometry '
                        'came since')

    def _set_back(self, judged: Judgement) -> None:
        """Go on after time was set back: in the old time where the odometry goes on."""
        stamp, (pose, _) = judged.good[0]
        if self._newest_pose is None or self.odometry.latest is None:
            return
        if continued(self._newest_pose, pose):
            period = self._odometry_stamps.period or USUAL_PERIOD
            self._clock.odometry_shift = self.odometry.latest + period - stamp
            return
        self.odometry.clear()
        self._queue.clear()
        self._clock.forget()
        self._clock.odometry_shift = 0.0
        self._began_anew()

    def _count_stray(self, stream: str, stamps: list[float], last: float) -> None:
        """Count messages that are left out for their stamps [s]."""
        for stamp in stamps:
            if 0.0 < last - stamp < LATE:
                self._count(f'{stream}_stamps_backward', 'one is stamped before the one ahead of '
                            f'it, by {last - stamp:.3f} s')
            else:
                self._count(f'{stream}_stamps_stray', f'one is stamped {stamp:.3f} s, those '
                            f'around it {last:.3f} s')

    def _count_leap(self, stream: str, judged: Judgement) -> None:
        """Count a clock that was set back; a leap ahead may be a pause, which is no fault."""
        if judged.leap < 0.0:
            self._count(f'{stream}_time_jumped_back',
                        f'by {-judged.leap:.3f} s to {judged.good[0].stamp:.3f} s')


def continued(before: Array, after: Array) -> bool:
    """Tell whether odometry (3,) goes on from before a jump of time."""
    x, y, turn = between(np.asarray(before, dtype=float), np.asarray(after, dtype=float))
    return bool(np.hypot(x, y) < CONTINUED_DISTANCE and abs(turn) < CONTINUED_HEADING)
