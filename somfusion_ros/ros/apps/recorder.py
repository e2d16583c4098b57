# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes down what a team of robots publishes: maps, paths, global maps, transforms, diagnostics.

It hears only the topics that any other program can hear. `status.json` in its folder is renewed
while it runs; the maps are written when it ends.
"""

import argparse
from functools import partial
import json
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathMessage
import numpy as np
from rclpy.node import Node
from somfusion_ros.grid import MAX_CELLS
from somfusion_ros.io.result import write_robot_map
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.ros.common import names, qos
from somfusion_ros.ros.common.conversions import (grid_from_message, pose_from_message, seconds,
                                                  transform_from_message)
from somfusion_ros.ros.common.runtime import plain_args, run
from somfusion_ros.whole_files import write_text

STATUS = 'status.json'
PERIOD = 0.5   # [s] between two writings of the status


class RecorderNode(Node):
    """Hears every robot of a list."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__('recorder')
        self._folder = Path(options.folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._started = time.time()
        self._maps: dict[tuple[str, str], OccupancyGrid] = {}
        self._paths: dict[str, PathMessage] = {}
        self._status: dict[str, Any] = {'robots': {}, 'diagnostics': {}}
        for robot in options.robots:
            self._hear(robot)
        self.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics,
                                 qos.STREAM)
        self.create_timer(PERIOD, self._write_status)

    def _hear(self, robot: str) -> None:
        """Subscribe to one robot's results."""
        self._status['robots'][robot] = {'maps': {}, 'transforms': {}, 'first_pose': None}
        for topic in (names.MAP, names.GLOBAL_MAP):
            self.create_subscription(OccupancyGrid, f'/{robot}/{topic}',
                                     partial(self._on_map, robot, topic), qos.LATCHED)
        self.create_subscription(PathMessage, f'/{robot}/{names.PATH}',
                                 partial(self._on_path, robot), qos.LATEST)
        self.create_subscription(TransformStamped, f'/{robot}/{names.RELATIVE_TRANSFORMS}',
                                 partial(self._on_transform, robot), qos.LATCHED_PER_PAIR)
        self.create_subscription(PoseWithCovarianceStamped, f'/{robot}/{names.ROBOT_POSE}',
                                 partial(self._on_pose, robot), qos.STREAM)

    def _on_map(self, robot: str, topic: str, message: OccupancyGrid) -> None:
        """Keep the newest map of a kind; count them."""
        self._maps[robot, topic] = message
        self._seen(self._status['robots'][robot]['maps'], topic).update(
            stamp=seconds(message.header.stamp), frame=message.header.frame_id,
            width=message.info.width, height=message.info.height)

    def _on_path(self, robot: str, message: PathMessage) -> None:
        """Keep the newest path."""
        self._paths[robot] = message

    def _on_transform(self, robot: str, message: TransformStamped) -> None:
        """Keep the newest transform to each peer."""
        pose = transform_from_message(message)
        self._seen(self._status['robots'][robot]['transforms'], message.child_frame_id).update(
            parent=message.header.frame_id, pose=list(pose))

    def _on_pose(self, robot: str, message: PoseWithCovarianceStamped) -> None:
        """Keep the first pose: it ties the map frame to the truth."""
        record = self._status['robots'][robot]
        if record['first_pose'] is None:
            pose = pose_from_message(message.pose.pose)
            record['first_pose'] = {'stamp': seconds(message.header.stamp), 'pose': list(pose),
                                    'first': time.time() - self._started}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep the newest status of every name."""
        for status in message.status:
            self._status['diagnostics'][status.name] = {
                'message': status.message, 'hardware_id': status.hardware_id,
                'values': {item.key: item.value for item in status.values}}

    def _seen(self, records: dict[str, Any], key: str) -> dict[str, Any]:
        """Count a message under a key and note its time [s] since the start."""
        now = time.time() - self._started
        record: dict[str, Any] = records.setdefault(key, {'count': 0, 'first': now})
        record.update(count=record['count'] + 1, last=now)
        return record

    def _write_status(self) -> None:
        """Write status.json in one step, so that a reader never finds half of it."""
        write_text(self._folder / STATUS, json.dumps(self._status, indent=2) + '\n')

    def close(self, timeout: float) -> bool:
        """Write the maps, the paths and the last status."""
        for robot in self._status['robots']:
            self._write_path(robot)
        for (robot, topic), message in self._maps.items():
            try:
                grid = grid_from_message(message, MAX_CELLS)
            except ValueError as error:
                self.get_logger().error(f'{robot}/{topic}: {error}')
            else:
                write_robot_map(self._folder / robot / topic, grid)
        self._write_status()
        return True

    def _write_path(self, robot: str) -> None:
        """Write the views of a robot's last path."""
        poses = self._paths[robot].poses if robot in self._paths else []
        folder = self._folder / robot
        folder.mkdir(exist_ok=True)
        write_tum(folder / 'path.tum', np.array([seconds(p.header.stamp) for p in poses]),
                  np.array([pose_from_message(p.pose) for p in poses]))


def main(args: list[str] | None = None) -> int:
    """Write down what robots publish: `recorder FOLDER ROBOT [ROBOT ...]`."""
    parser = argparse.ArgumentParser(prog='recorder', description=main.__doc__)
    parser.add_argument('folder', help='where to write status.json and the maps')
    parser.add_argument('robots', nargs='+', help='namespaces of the robots')
    options = parser.parse_args(plain_args(args))
    return run(lambda stop: RecorderNode(options), args)


if __name__ == '__main__':
    raise SystemExit(main())
