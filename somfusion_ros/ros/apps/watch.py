# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Shows a team's maps in the terminal as they merge, for who comes to a robot by ssh.

It only listens, to what every other program can hear. Where its output is no terminal it shows
the team once.
"""

import argparse
from contextlib import suppress
from functools import partial
from pathlib import Path
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from somfusion_ros.grid import MAX_CELLS
from somfusion_ros.report.watch_view import Health, HeardTeam, view
from somfusion_ros.ros.apps.watch_options import parse
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.parameter_sets import SETS
from somfusion_ros.ros.common.peers import find_robots, robot_of
from somfusion_ros.ros.common.runtime import plain_args, run
from somfusion_ros.whole_files import write_text

PERIOD = 0.5   # [s] between two pictures
WIDTH, HEIGHT = 110, 40   # of a picture where there is no terminal


class WatchNode(Node):
    """Hears every robot that shows up, and draws from a timer."""

    def __init__(self, options: argparse.Namespace, stop: threading.Event) -> None:
        super().__init__('watch')
        self._options, self._stop = options, stop
        self._team = HeardTeam()
        self._heard: set[str] = set()
        self._until = time.monotonic() + options.wait
        terminal = sys.stdout.isatty()
        self._console = Console(record=bool(options.svg), force_terminal=terminal or None,
                                width=None if terminal else WIDTH,
                                height=None if terminal else HEIGHT)
        self._once = options.once or not terminal
        self._live = None if self._once else Live(console=self._console, screen=True,
                                                  auto_refresh=False)
        if self._live:
            self._live.start()
        self.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics,
                                 qos.STREAM)
        self.create_timer(PERIOD, self._draw)

    def close(self, timeout: float) -> bool:
        """Restore the terminal, and write the picture if one was asked for."""
        if self._live:
            self._live.stop()
            self._console.print(self._view())
        if self._options.svg:
            write_text(Path(self._options.svg),
                       self._console.export_svg(title='somfusion watch'))
        return True

    def _draw(self) -> None:
        """Listen to new robots and show what is known."""
        for robot in find_robots(self.get_topic_names_and_types(), self._options.map_topic,
                                 names.MAP_TYPE):
            if robot not in self._heard:
                self._heard.add(robot)
                self._listen(robot)
        if self._live:
            self._live.update(self._view(), refresh=True)
        elif time.monotonic() > self._until and not self._stop.is_set():
            self._console.print(self._view())
            self._stop.set()

    def _view(self) -> Any:
        """Draw the team for the terminal as it is now."""
        return view(self._team, self._console.width, self._console.height)

    def _listen(self, robot: str) -> None:
        """Subscribe to one robot; '' is the one in the root namespace, which is shown as /."""
        below, robot = f'/{robot}' if robot else '', robot or '/'
        self.create_subscription(OccupancyGrid, f'{below}/{self._options.map_topic}',
                                 partial(self._on_map, robot), qos.LATCHED)
        self.create_subscription(TransformStamped, f'{below}/{names.RELATIVE_TRANSFORMS}',
                                 partial(self._on_transform, robot), qos.LATCHED_PER_PAIR)
        self.create_subscription(PoseWithCovarianceStamped, f'{below}/{names.ROBOT_POSE}',
                                 partial(self._on_pose, robot), qos.STREAM)

    def _on_map(self, robot: str, message: OccupancyGrid) -> None:
        try:
            grid = convert.grid_from_message(message, MAX_CELLS)
        except ValueError as error:
            self._team.health[f'{robot}/map'] = Health(2, str(error), {})
            return
        if grid.occupied.any():
            self._team.grids[robot] = grid

    def _on_transform(self, robot: str, message: TransformStamped) -> None:
        with suppress(ValueError):   # what is not finite is no place
            self._team.transforms.setdefault(robot, {})[robot_of(message.child_frame_id)] = (
                convert.transform_from_message(message))

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        with suppress(ValueError):
            self._team.poses[robot] = convert.pose_from_message(message.pose.pose)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep what the team's nodes say; drivers and Nav2 are on the same topic."""
        for status in message.status:
            if status.name.partition(':')[0].rpartition('/')[2] not in SETS:
                continue
            self._team.health[status.name] = Health(
                status.level[0], status.message, {v.key: v.value for v in status.values})


def main(args: list[str] | None = None) -> int:
    """Show a team's maps in the terminal as they merge."""
    options = parse(plain_args(args))
    return run(lambda stop: WatchNode(options, stop), args)


if __name__ == '__main__':
    raise SystemExit(main())
