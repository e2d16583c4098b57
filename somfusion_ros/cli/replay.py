# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion replay`: logs of one or more robots in, maps and trajectories out."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TYPE_CHECKING

from somfusion_ros.cli.options import (add_fusion, add_output, Commands, count, given, pose,
                                       positive)
from somfusion_ros.node_config import ODOMETRY_SOURCES, SlamNodeConfig
from somfusion_ros.slam.config import BEAM_ORDERS

if TYPE_CHECKING:
    from somfusion_ros.io.bags.log import BagOptions


def add(commands: Commands) -> None:
    """Describe `replay`."""
    command = commands.add_parser(
        'replay', help='logs of one or more robots -> maps, trajectories, global map',
        description='Run the SLAM over one bag per robot, then merge the maps. Topics, laser '
                    'mount and odometry are found in each bag unless they are named here.')
    command.add_argument('bags', nargs='+', metavar='BAG',
                         help='rosbag1, or rosbag2 in sqlite3 or mcap; one robot '
                              'per bag, or several in namespaces')
    add_output(command)
    command.add_argument('--namespaces', nargs='+', default=[], metavar='ROBOT',
                         help='namespaces of the robots in one bag (default: all that it holds)')
    command.add_argument('--scan-topic', help='topic of the laser scans')
    command.add_argument('--odom-topic', help='topic of nav_msgs/Odometry')
    command.add_argument('--odometry-source', choices=ODOMETRY_SOURCES,
                         help='odom: nav_msgs/Odometry; encoders: two wheels in joint states; '
                              'tf: odom -> base in /tf; none: from the scans alone; auto (the '
                              'default): the first of odom, encoders and tf in the bag, '
                              'else none')
    command.add_argument('--laser-pose', type=pose, metavar='X,Y,THETA',
                         help='laser in the base frame [m, m, rad], instead of tf_static; '
                              'write --laser-pose=-0.1,0,0 where X is negative')
    command.add_argument('--beam-order', choices=BEAM_ORDERS,
                         help='order in time of the beams of a scan (default: learned while the '
                              'robot turns)')
    command.add_argument('--wheel-radius', type=positive, metavar='M', help='for encoders [m]')
    command.add_argument('--wheel-separation', type=positive, metavar='M',
                         help='for encoders [m]')
    command.add_argument('--resolution', type=positive, metavar='M',
                         help='edge of a map cell [m] (default 0.05)')
    command.add_argument('--jobs', type=count, metavar='N',
                         help='robots at work at once (default: one per core)')
    command.add_argument('--bag', action='store_true',
                         help='also write DIR/bag (mcap): maps, poses, tf, clusters and the '
                              'global map over time, for Foxglove and RViz')
    where = command.add_mutually_exclusive_group()
    where.add_argument('--state', type=Path, metavar='FILE',
                       help='go on from this state of an earlier run where there is one, '
                            'wherever the robot starts, and write it at the end; for one bag')
    where.add_argument('--localize', type=Path, metavar='MAP',
                       help='find and track the robot in this map (map.yaml of map_server, or a '
                            'state), and leave it as it is; for one bag')
    add_fusion(command)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run `replay`."""
    from somfusion_ros.fusion.config import FusionConfig
    from somfusion_ros.io.parameters import make, read_parameters
    from somfusion_ros.offline.replay import replay, ReplayOptions
    from somfusion_ros.slam.config import SlamConfig
    values = read_parameters(options.parameters)
    replay(options.bags, options.output, ReplayOptions(
        bag_options(options, values),
        make(SlamConfig, values, **given(resolution=options.resolution,
                                         beam_order=options.beam_order)),
        make(FusionConfig, values, **given(method=options.method)),
        options.jobs, not options.no_report, options.bag, tuple(options.namespaces),
        options.state, options.localize))


def bag_options(options: argparse.Namespace, values: Mapping[str, Any]) -> 'BagOptions':
    """Return what to use of the bags: the options given, else slam_node's parameters."""
    from somfusion_ros.geometry import Pose
    from somfusion_ros.io.bags.log import BagOptions
    from somfusion_ros.io.parameters import make
    node = make(SlamNodeConfig, values)
    source = options.odometry_source or node.odometry_source
    told = values if source == 'encoders' else {}   # a file of all defaults tells of wheels, too
    mount = None if node.given_mount is None else Pose.from_array(node.given_mount)
    return BagOptions(
        options.scan_topic, options.odom_topic, source, options.laser_pose or mount,
        options.wheel_radius or told.get('wheel_radius'),
        options.wheel_separation or told.get('wheel_separation'))
