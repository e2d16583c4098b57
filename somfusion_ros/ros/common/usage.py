# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node says to `--help`: how it is started, and its parameters."""

from dataclasses import fields
from textwrap import fill

from somfusion_ros.ros.common.parameter_sets import SETS
from somfusion_ros.ros.common.parameter_yaml import scalar, sentence

WIDTH = 99
PURPOSES = {
    'slam_node': "One robot's SLAM: scans and odometry in, map, pose and path out.",
    'fusion_node': "One robot's part in the team: the maps of the robots in, where they lie in "
                   'one another and a global map out.'}


def usage(node: str) -> str:
    """Return the text for `ros2 run somfusion_ros <node> --help`."""
    lines = [
        f'usage: ros2 run somfusion_ros {node} --ros-args -r __ns:=/robot1 '
        '[-p PARAMETER:=VALUE ...] [--params-file FILE]', '',
        fill(PURPOSES[node], WIDTH), '',
        fill(f'As a rule: ros2 launch somfusion_ros robot.launch.py namespace:=robot1. Topics, '
             f'services and frames are in the README; while the node runs, ros2 node info '
             f'/robot1/{node} lists them, and ros2 param describe tells of its parameters.',
             WIDTH)]
    for title, config in SETS[node].items():
        lines += ['', f'{title}:']
        for item in fields(config):
            lines += [f'  {item.name} (default {scalar(item.default)})',
                      fill(sentence(item), WIDTH, initial_indent=' ' * 6,
                           subsequent_indent=' ' * 6)]
    return '\n'.join(lines) + '\n'
