# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Nav2 for one robot that navigates in the team's `world`, and explore_lite if wanted.

ros2 launch somfusion_ros navigate.launch.py namespace:=robot1 explore:=true

Start it beside robot.launch.py. Goals are given in `world` or in the robot's own `map`.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory('somfusion_ros')) / 'config'
ARGUMENTS = {
    'namespace': (None, 'Namespace of the robot, as of robot.launch.py.'),
    'params_file': (str(CONFIG / 'nav2_world.yaml'), "Parameter file of Nav2's nodes."),
    'explore': ('false', 'Explore what the team does not know, with explore_lite.'),
    'explore_params': (str(CONFIG / 'explore_world.yaml'), 'Parameter file of explore_lite.'),
    'use_sim_time': ('false', 'Take the time from /clock.'),
    'use_respawn': ('false', 'Start a node again when it ends.'),
    'log_level': ('info', 'How much the nodes say.'),
}
CHOICES = {'log_level': ['debug', 'info', 'warn', 'error', 'fatal']}
NODES = {'controller_server': 'nav2_controller', 'planner_server': 'nav2_planner',
         'behavior_server': 'nav2_behaviors', 'bt_navigator': 'nav2_bt_navigator'}
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]


def generate_launch_description() -> LaunchDescription:
    """Start Nav2's nodes, their manager, and the explorer."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    clock = {'use_sim_time': given['use_sim_time']}
    common = {'namespace': given['namespace'], 'output': 'screen', 'remappings': TRANSFORMS,
              'ros_arguments': ['--log-level', given['log_level']]}
    parameters = [given['params_file'], clock]
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description,
                                choices=CHOICES.get(name))
          for name, (default, description) in ARGUMENTS.items()),
        *(Node(package=package, executable=name, name=name, parameters=parameters,
               respawn=given['use_respawn'], respawn_delay=2.0, **common)
          for name, package in NODES.items()),
        Node(package='nav2_lifecycle_manager', executable='lifecycle_manager',
             name='lifecycle_manager_navigation', parameters=parameters, **common),
        Node(package='explore_lite', executable='explore', name='explore_node',
             parameters=[given['explore_params'], clock],
             condition=IfCondition(given['explore']), **common)])
