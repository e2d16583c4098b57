# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that sends garbage of every kind, a hundred messages a second, until it is ended."""

import argparse
from array import array

from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from somfusion_ros.geometry import Pose
from somfusion_ros.ros.common import qos
from somfusion_ros.ros.fusion.team_messages import bytes_message
from somfusion_ros.team.map_codec import MapEncoder
from somfusion_ros.team.shared_map import MapCells
from std_msgs.msg import String, UInt8MultiArray

PERIOD = 0.01      # [s]
MILLION = 10 ** 6


class HostileRobot(Node):
    """Publishes what no robot should, on every topic on which robots are heard."""

    def __init__(self, robot: str) -> None:
        super().__init__('hostile_robot', namespace=f'/{robot}')
        self._rng, self._count = np.random.default_rng(0), 0
        encoder = MapEncoder()
        encoder.encode(MapCells(np.zeros((50, 50), np.int8), 0.05, Pose()))
        self._stream = encoder.key
        kinds = ((String, 'team/state', self._state), (UInt8MultiArray, 'team/map', self._bytes),
                 (UInt8MultiArray, 'team/map_changes', self._bytes),
                 (PointCloud2, 'clusters', self._cloud), (OccupancyGrid, 'map', self._grid))
        self._jobs = [(self.create_publisher(kind, topic, qos.LATCHED), make)
                      for kind, topic, make in kinds]
        self.create_timer(PERIOD, self._send)

    def _send(self) -> None:
        """Send one message."""
        publisher, make = self._jobs[self._count % len(self._jobs)]
        self._count += 1
        publisher.publish(make())

    def _noise(self, most: int = 2000) -> bytes:
        """Return a few bytes."""
        return self._rng.integers(0, 256, self._rng.integers(1, most), dtype=np.uint8).tobytes()

    def _state(self) -> String:
        """Make a state that is none, or one with a new session each time."""
        good = '{"session": "%d", "constraints": [], "departed": []}' % self._count
        return String(data=good if self._count % 2 else self._noise().hex())

    def _bytes(self) -> UInt8MultiArray:
        """Make bytes that are no map, or nearly one."""
        near = self._stream[:self._rng.integers(len(self._stream))]
        return bytes_message(self._noise() if self._count % 2 else near)

    def _cloud(self) -> PointCloud2:
        """Make a cloud without fields."""
        return PointCloud2(width=MILLION, height=MILLION, data=array('B', self._noise()))

    def _grid(self) -> OccupancyGrid:
        """Make a map of a million by a million cells, of no size, or without data."""
        message = OccupancyGrid()
        message.info.width = int(self._rng.choice([0, 10, MILLION]))
        message.info.height = message.info.width
        message.info.resolution = float(self._rng.choice([0.0, 1e-9, float('nan'), 0.05]))
        message.info.origin.position.x = float(self._rng.choice([1e300, float('nan'), 0.0]))
        message.data = array('b', bytes(int(self._rng.choice([0, 100]))))
        return message


def main() -> None:
    """Run until ended."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('robot')
    rclpy.init(args=[])
    try:
        rclpy.spin(HostileRobot(parser.parse_args().robot))
    except KeyboardInterrupt:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
