# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The two threads of slam_node.

One follows the robot scan by scan, the other one closes loops, draws maps and serves, so that
neither of them holds up what comes in.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import time
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
import numpy as np
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import write_map
from somfusion_ros.offline.beginning import Beginning, from_grid
from somfusion_ros.ros.common.conversions import time_message
from somfusion_ros.ros.common.worker import Worker
from somfusion_ros.ros.slam.publisher import SlamPublisher
from somfusion_ros.ros.slam.status import Last
from somfusion_ros.slam.bend import Bend
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.checkpoint_file import load_checkpoint, save_checkpoint
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.slam import Slam

TICK = 0.1   # [s] between looks at scans that wait in vain
DRAWN_AT_ONCE = 1000   # scans that are drawn, or drawn anew, before anything else may be done


class Pipeline:
    """
    A SLAM session at work: scans and odometry in, poses and maps out.

    make_session makes a session that begins so; say takes sentences for the log. map: the map as
    published last, None before the first; map_interval: time [s] between two maps.
    """

    def __init__(self, make_session: Callable[[Beginning], Session], beginning: Beginning,
                 keeper: CheckpointKeeper, publisher: SlamPublisher, last: Last,
                 count: Callable[..., None], say: Callable[[str], object]) -> None:
        self._make_session, self._keeper, self._publisher = make_session, keeper, publisher
        self._last, self._count, self._say = last, count, say
        self.map: OccupancyGrid | None = None
        self.map_interval = 5.0
        self._ticks = 0
        self._drawn: Any = None
        self._begin(beginning)

    def start(self) -> None:
        """Start both threads."""
        self._tracker = Worker(self._process, self._on_error, TICK)
        self._mapper = Worker(self._work, self._on_error)
        self._tracker.start()
        self._mapper.start()

    def stop(self, timeout: float) -> bool:
        """Stop both threads and keep the state; return whether they ended in time."""
        ended = self._tracker.close(timeout)
        ended = self._mapper.close(timeout) and ended
        if ended:
            self._keeper.keep(self.session.slam, self._last.step, float('inf'))
            self._keeper.shut(self._last.step)
        return ended

    def tick(self) -> None:
        """
        Let time pass for the scans that wait.

        Ticks are the clock of the waiting: they stand still while the node's callbacks are held
        up, so a scan is never dropped for odometry that lies in the queue already.
        """
        self._ticks += 1

    def add_scan(self, scan: Scan, stamp: Time, bodies: Bodies) -> None:
        """Queue a scan until its odometry comes; bodies are where other robots are now."""
        bend, step = self.session.slam.bend, self._last.step
        self.session.bodies = bend.bodies(bodies, step.view) if step else bodies
        self.session.add_scan(scan, stamp, self._ticks * TICK)
        self._tracker.wake()

    def add_odometry(self, stamp: float, pose: Any, slip: Any) -> None:
        """Keep a pose of the wheel odometry."""
        self.session.add_odometry(stamp, pose, slip)
        self._tracker.wake()

    def add_turn(self, stamp: float, rate: float) -> None:
        """Keep a turn rate [rad/s] of a gyroscope."""
        self.session.add_turn_rate(stamp, rate)

    def submit(self, job: Callable[[], Any]) -> None:
        """Run a job soon in the thread that draws maps."""
        self._mapper.submit(job)

    def save_map(self, stem: Path) -> str:
        """Write the map as it is now as `<stem>.yaml` and `<stem>.pgm`; return what was done."""
        if not len(self.session.slam.views()[0]):
            raise ValueError('there is no map to save yet: no scan could be used')
        slam, stamp = self.session.slam, self._last.stamp
        grid = slam.grid()
        self._publish_map(slam, grid, stamp)
        path = write_map(stem.parent, grid, stem.name)
        return f'map saved to {path}'

    def serialize(self, stem: Path) -> str:
        """Write the state, from which SLAM can go on, as `<stem>.npz`; return what was done."""
        state, path = self.session.slam.checkpoint(), stem.with_name(f'{stem.name}.npz')
        if not len(state.poses):
            raise ValueError('there is nothing to serialize yet: no scan could be used')
        save_checkpoint(path, state)
        return f'{len(state.poses)} views saved to {path}'

    def deserialize(self, stem: Path) -> str:
        """Go on from `<stem>.npz` in place of the present map; return what was done."""
        path = stem.with_name(f'{stem.name}.npz')
        try:
            state = load_checkpoint(path, self._count)
        except FileNotFoundError as error:
            raise ValueError(f'{path} does not exist') from error
        start = replace(self._beginning.start, drawn=None)
        self._tracker.submit(lambda: self._begin(Beginning(state, start)))
        return f'goes on from {len(state.poses)} views of {path}'

    def localize_in(self, grid: Grid) -> None:
        """Begin to look for the robot in a drawn map, in the thread that draws maps."""
        def look() -> None:
            beginning = from_grid(grid)
            self._tracker.submit(lambda: self._begin(beginning))
        self._mapper.submit(look)

    def relocate(self, pose: Pose, P: Array) -> None:
        """Believe that the robot is at a pose in the map, with covariance P (3, 3)."""
        def stand() -> None:
            slam = self.session.slam
            if not len(slam.views()[0]):
                self._say('initialpose: there is no map yet that the pose could be in')
                return
            slam.relocate(slam.bend.undo(np.array(pose), slam.views()[1]), P)
            self._last.placed = True
            self._say(f'initialpose: the robot is taken to be at {pose.x:.2f} m, {pose.y:.2f} m, '
                      f'{np.degrees(pose.theta):.1f} deg in the map')
        self._tracker.submit(stand)

    def straighten(self, stamps: Array, joint: Array) -> None:
        """Show the map as peers' views straighten it: views of stamps (m,) lie at joint (m, 3)."""
        slam = self.session.slam
        known, own = slam.views()
        n = len(stamps)
        if 1 < n <= len(own) and np.allclose(known[:n], stamps, 0.0, 1e-4):
            slam.bend = Bend.of(own[:n], joint)     # else it is of another map
            self._drawn = None

    def reset(self) -> str:
        """Begin a new map, or look for the robot in the given map anew; return what was done."""
        if self._beginning.start.localization:
            beginning = self._beginning
            self._tracker.submit(lambda: self._begin(beginning))
            return 'the robot is sought in the map anew'
        self._keeper.forget(self.session.slam)
        self._tracker.submit(lambda: self._begin(Beginning()))
        return 'a new map begins'

    def _begin(self, beginning: Beginning) -> None:
        """Begin a new map, or go on in one, which is shown before the first scan."""
        self.session, self._beginning = self._make_session(beginning), beginning
        slam = self.session.slam
        self._publisher.epoch(slam.epoch)
        self._last.step = self._last.stamp = self.map = None
        self._last.placed, self._found = not slam.lost, 0
        if np.isfinite(slam.last_stamp):
            self._last.stamp = time_message(slam.last_stamp)
        self._drawn = None   # the map is drawn after a step, or as the run begins with it
        self._map_due, self._telling = 0.0, False

    def _process(self) -> bool:
        """Follow the robot through one scan that odometry covers; return whether there was one."""
        start = time.perf_counter()
        found = next(self.session.steps(self._ticks * TICK), None)
        self._last.odometry_late = self.session.pairing.odometry_late
        if found is None or self._tracker.stopping:
            return False
        stamp, step = found
        self._last.scan_seconds = time.perf_counter() - start
        self._last.scans += 1
        self._publisher.epoch(self.session.slam.epoch)   # a jump of time may have begun a map
        if step.accepted:
            shown = self.session.slam.bend.step(step)
            self._last.stamp, self._last.step = stamp, shown
            self._last.placed = self._last.placed or step.reason != 'lost'
            self._publisher.pose(shown, stamp)
        self._tell_found()
        return True

    def _tell_found(self) -> None:
        """Log where a lost robot was found."""
        slam = self.session.slam
        for found in slam.found[self._found:]:
            x, y, theta = slam.pose_sigma
            self._say(f'found in the map after {found.metres:.1f} m, with a sigma of {x:.2f} m, '
                      f'{y:.2f} m, {np.degrees(theta):.1f} deg')
        self._found = len(slam.found)

    def _work(self) -> bool:
        """Close one loop, draw, or tell some views; return whether there is more."""
        slam = self.session.slam
        more = slam.work()
        if more:
            self._drawn = None      # views may have moved
        if time.monotonic() >= self._map_due:
            more = self._show(slam) or more
        if self._telling:
            self._telling = self._publisher.views(slam)
        self._keeper.keep(slam, self._last.step, time.monotonic())
        self._last.not_saved = self._keeper.fault
        return more or self._telling

    def _show(self, slam: Slam) -> bool:
        """Draw some of the map, and publish it once it is whole; return whether it is not."""
        stamp = self._last.stamp    # before the map is drawn: scans go on coming meanwhile
        newest = self._last.step or self._beginning.checkpoint
        if newest is not self._drawn:
            grid = slam.grid(DRAWN_AT_ONCE)
            if slam.counters['map_scans_undrawn']:
                return True      # of a long map that is gone on with
            self._publish_map(slam, grid, stamp)
            self._drawn = None if slam.counters['map_scans_behind'] else newest
        elif self.map is not None:
            self._publisher.repeat_map()
        self._map_due = time.monotonic() + self.map_interval
        return False

    def _publish_map(self, slam: Slam, grid: Grid, stamp: Time | None) -> None:
        """Publish a map that holds all up to a stamp."""
        if slam.counters['map_scans_too_far']:
            self._count('maps_too_large', 'scans are not drawn, as the map would be too large')
        if slam is self.session.slam and not self._mapper.stopping:   # else it is drawn in vain
            self.map = self._publisher.map_message(grid, slam, stamp or Time())
            self._publisher.grid(self.map, grid, slam)   # whoever hears of it may ask for it
            self._telling = True

    def _on_error(self, error: Exception) -> None:
        self._count('worker_errors', repr(error))
