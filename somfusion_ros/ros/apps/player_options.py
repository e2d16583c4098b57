# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the player of bags can be told; no ROS is needed to say it."""

import argparse
from collections.abc import Sequence


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the arguments; on bad usage or `--help` the program ends."""
    parser = argparse.ArgumentParser(
        prog='player', description='Play bags as live robots: scan, odom, joint_states, imu, '
        'tf_static, and odom -> base_link on tf.',
        usage='%(prog)s BAG [BAG ...] [--rate R] [--clock] [--wait S] [--robots NAME [NAME ...]] '
        '[--scan-topic TOPIC [TOPIC ...]] [--odom-topic TOPIC [TOPIC ...]] '
        '[--ros-args -r __ns:=/robot1]')
    parser.add_argument('bags', nargs='+', metavar='BAG',
                        help='rosbag2 folder, .mcap, .db3 or rosbag1 file')
    parser.add_argument('--robots', nargs='+', metavar='NAME',
                        help='namespaces of the bags (several bags: robot1 robot2 ...)')
    for option, what in (('--scan-topic', 'laser scans'), ('--odom-topic', 'odometry')):
        parser.add_argument(option, nargs='+', default=[], metavar='TOPIC',
                            help=f'topic of the {what} in the bags, where there are several: one '
                            'for all bags, or one for each')
    parser.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='times real time (default 1)')
    parser.add_argument('--clock', action='store_true',
                        help='publish the time of recording on /clock, for use_sim_time')
    parser.add_argument('--wait', type=float, default=10.0, metavar='S',
                        help='how long to wait for listeners before playing [s] (default 10)')
    options = parser.parse_args(arguments)
    for option, topics in (('--scan-topic', options.scan_topic),
                           ('--odom-topic', options.odom_topic)):
        if len(topics) not in (0, 1, len(options.bags)):
            parser.error(f'{option} {" ".join(topics)}: {len(topics)} topics for '
                         f'{len(options.bags)} bags')
    if not 0.0 < options.rate < float('inf'):
        parser.error('--rate must be positive')
    if not 0.0 <= options.wait < float('inf'):
        parser.error(f'--wait {options.wait} is no time in seconds')
    return options
