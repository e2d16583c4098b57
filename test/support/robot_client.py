# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Stands for a robot beside its fusion node: publishes its map and pose, and hears what comes out.

A process of its own, so that it can live in another network namespace than the test. A line of
JSON on stdin is a command, answered with a line of JSON on stdout:
{"map": FILE} publishes a map saved by `save_cells`; {"pose": [x, y, theta], "stamp": s};
{"global_map": FILE} saves the newest global map there; {"forget": true} forgets what was heard;
{} does nothing. The answer tells of the
global map, of the transforms and of the diagnostics heard so far.
"""

import argparse
import json
from pathlib import Path
import selectors
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.ros.common import conversions as convert
from somfusion_ros.ros.common import qos
from somfusion_ros.team.shared_map import MapCells

LIMIT = 10 ** 8


def save_cells(path: Path, cells: MapCells) -> None:
    """Write cells to a file."""
    np.savez(path, values=cells.values, resolution=cells.resolution,
             origin=np.array(cells.T_frame_grid))


def load_cells(path: Path) -> MapCells:
    """Read cells from a file."""
    with np.load(path) as record:
        return MapCells(record['values'], float(record['resolution']),
                        Pose.from_array(record['origin']))


class RobotClient(Node):
    """One robot's SLAM, and somebody who looks at its results."""

    def __init__(self, robot: str) -> None:
        super().__init__('robot_client', namespace=f'/{robot}')
        self._map = self.create_publisher(OccupancyGrid, 'map', qos.LATCHED)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, 'pose', qos.STREAM)
        self._forget()
        self.create_subscription(OccupancyGrid, 'global_map', self._on_global_map, qos.LATCHED)
        self.create_subscription(TransformStamped, 'relative_transforms', self._on_transform,
                                 qos.LATCHED_PER_PAIR)
        self.create_subscription(DiagnosticArray, 'diagnostics', self._on_diagnostics,
                                 qos.STREAM)

    def _forget(self) -> None:
        """Forget what was heard."""
        self._global_map: OccupancyGrid | None = None
        self._seen: dict[str, Any] = {'global_maps': 0, 'transforms': {}, 'status': {}}

    def obey(self, command: dict[str, Any]) -> dict[str, Any]:
        """Do what a command says, and tell what was heard."""
        if 'forget' in command:
            self._forget()
        stamp = convert.time_message(float(command.get('stamp', 1.0)))
        if 'map' in command:
            cells = load_cells(Path(command['map']))
            grid = Grid.from_occupancy(cells.values, cells.resolution, cells.T_frame_grid)
            self._map.publish(convert.grid_message(grid, 'map', stamp))
        if 'pose' in command:
            self._pose.publish(convert.pose_with_covariance(
                Pose(*command['pose']), np.eye(3) * 1e-4, 'map', stamp))
        if 'global_map' in command and self._global_map is not None:
            save_cells(Path(command['global_map']),
                       convert.cells_from_message(self._global_map, LIMIT))
        return self._seen

    def _on_global_map(self, message: OccupancyGrid) -> None:
        """Keep the newest global map."""
        self._global_map = message
        self._seen['global_maps'] += 1

    def _on_transform(self, message: TransformStamped) -> None:
        """Keep the newest transform to each peer."""
        self._seen['transforms'][message.child_frame_id.rpartition('/')[0]] = list(
            convert.transform_from_message(message))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep the newest status of this robot's fusion node, and of each of its peers."""
        own = f'{self.get_namespace().strip("/")}/fusion_node'
        for status in message.status:
            node, _, peer = status.name.partition(': ')
            if node == own:
                self._seen['status'][peer] = {item.key: item.value for item in status.values}


def main() -> None:
    """Run until stdin ends."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('robot')
    options = parser.parse_args()
    rclpy.init(args=[])
    node, executor, selector = RobotClient(options.robot), SingleThreadedExecutor(), (
        selectors.DefaultSelector())
    executor.add_node(node)
    selector.register(sys.stdin, selectors.EVENT_READ)
    while True:
        executor.spin_once(timeout_sec=0.05)
        if selector.select(0.0):
            line = sys.stdin.readline()
            if not line:
                break
            sys.stdout.write(json.dumps(node.obey(json.loads(line))) + '\n')
            sys.stdout.flush()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
