# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One robot: a SLAM and the fusion_node in the robot's namespace.

ros2 launch somfusion_ros robot.launch.py namespace:=robot1

With slam:=slam_toolbox its own launch file is included; with slam:=none any other SLAM of the
robot may publish `map`.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import (EqualsSubstitution, LaunchConfiguration, PathJoinSubstitution,
                                  PythonExpression)
from launch_ros.actions import Node, PushRosNamespace, SetRemap
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = Path(get_package_share_directory('somfusion_ros')) / 'config'
ARGUMENTS = {
    'namespace': (None, 'Namespace and name of the robot; its peers find it by this name.'),
    'slam': ('slam_node', 'Who makes the map: slam_node, slam_toolbox, or none of them.'),
    'peers': ('', 'Names of the robots to merge with, separated by commas; empty: every robot.'),
    'use_sim_time': ('false', 'Take the time from /clock.'),
    'slam_params': (str(CONFIG / 'slam.yaml'), 'Parameter file of slam_node.'),
    'fusion_params': (str(CONFIG / 'fusion.yaml'), 'Parameter file of fusion_node.'),
    'slam_toolbox_params': ('', 'Parameter file of slam_toolbox; empty: its own default.'),
    'scan_topic': ('scan', "Topic of the robot's laser scans."),
    'odom_topic': ('odom', "Topic of the robot's wheel odometry."),
    'log_level': ('info', 'debug, info, warn, error or fatal.'),
}
CHOICES = {'slam': ['slam_node', 'slam_toolbox', 'none']}
# A robot's frames stay unprefixed because its transforms stay in its own namespace.
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]


def slam_toolbox() -> GroupAction:
    """Include slam_toolbox; its topics are absolute, so each is put into the namespace."""
    params = LaunchConfiguration('slam_toolbox_params')
    own = PathJoinSubstitution([FindPackageShare('slam_toolbox'), 'config',
                                'mapper_params_online_async.yaml'])
    chosen = PythonExpression(["'", params, "' or '", own, "'"])
    remaps = [*TRANSFORMS, ('/map', 'map'), ('/map_metadata', 'map_metadata'),
              ('/scan', LaunchConfiguration('scan_topic'))]
    return GroupAction([
        PushRosNamespace(LaunchConfiguration('namespace')),
        *(SetRemap(src=absolute, dst=relative) for absolute, relative in remaps),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(PathJoinSubstitution([
                FindPackageShare('slam_toolbox'), 'launch', 'online_async_launch.py'])),
            launch_arguments={'use_sim_time': LaunchConfiguration('use_sim_time'),
                              'slam_params_file': chosen}.items()),
    ], condition=IfCondition(EqualsSubstitution(LaunchConfiguration('slam'), 'slam_toolbox')))


def generate_launch_description() -> LaunchDescription:
    """Start both; each may be restarted alone."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    common = {
        'package': 'somfusion_ros', 'namespace': given['namespace'], 'output': 'screen',
        'ros_arguments': ['--log-level', given['log_level']]}
    clock = {'use_sim_time': given['use_sim_time']}
    peers = {'peers': ParameterValue(PythonExpression(["'", given['peers'], "'.split(',')"]),
                                     value_type=list[str])}
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description,
                                choices=CHOICES.get(name))
          for name, (default, description) in ARGUMENTS.items()),
        Node(executable='slam_node', name='slam_node', parameters=[given['slam_params'], clock],
             remappings=[*TRANSFORMS, ('scan', given['scan_topic']),
                         ('odom', given['odom_topic'])],
             condition=IfCondition(EqualsSubstitution(given['slam'], 'slam_node')), **common),
        slam_toolbox(),
        Node(executable='fusion_node', name='fusion_node',
             parameters=[given['fusion_params'], clock, peers], remappings=TRANSFORMS, **common),
    ])
