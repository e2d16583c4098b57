# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One robot: slam_node and fusion_node in the robot's namespace.

ros2 launch somfusion_ros robot.launch.py namespace:=robot1
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory('somfusion_ros')) / 'config'
ARGUMENTS = {
    'namespace': (None, 'Namespace and name of the robot; its peers find it by this name.'),
    'use_sim_time': ('false', 'Take the time from /clock.'),
    'slam_params': (str(CONFIG / 'slam.yaml'), 'Parameter file of slam_node.'),
    'fusion_params': (str(CONFIG / 'fusion.yaml'), 'Parameter file of fusion_node.'),
    'scan_topic': ('scan', "Topic of the robot's laser scans."),
    'odom_topic': ('odom', "Topic of the robot's wheel odometry."),
    'log_level': ('info', 'debug, info, warn, error or fatal.'),
}
# A robot's frames stay unprefixed because its transforms stay in its own namespace.
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]


def generate_launch_description() -> LaunchDescription:
    """Start both nodes; each may be restarted alone."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    common = {
        'package': 'somfusion_ros', 'namespace': given['namespace'], 'output': 'screen',
        'ros_arguments': ['--log-level', given['log_level']]}
    clock = {'use_sim_time': given['use_sim_time']}
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description)
          for name, (default, description) in ARGUMENTS.items()),
        Node(executable='slam_node', name='slam_node', parameters=[given['slam_params'], clock],
             remappings=[*TRANSFORMS, ('scan', given['scan_topic']),
                         ('odom', given['odom_topic'])], **common),
        Node(executable='fusion_node', name='fusion_node',
             parameters=[given['fusion_params'], clock], remappings=TRANSFORMS, **common),
    ])
