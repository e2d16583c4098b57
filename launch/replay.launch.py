# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A team out of recorded logs: per bag a player, a slam_node and a fusion_node in one namespace.

ros2 launch somfusion_ros replay.launch.py bags:="first second" rate:=2.0
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ROBOT = Path(get_package_share_directory('somfusion_ros')) / 'launch' / 'robot.launch.py'


def start_team(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Start the robots robot1, robot2 ... in the order of the bags."""
    bags = LaunchConfiguration('bags').perform(context).split()
    rate = LaunchConfiguration('rate').perform(context)
    entities: list[LaunchDescriptionEntity] = []
    for number, bag in enumerate(bags, start=1):
        name = f'robot{number}'
        # A source of its own: a description that was loaded once can be launched only once.
        entities.append(IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(ROBOT)),
            launch_arguments={'namespace': name}.items()))
        entities.append(Node(
            package='somfusion_ros', executable='player', name='player', namespace=name,
            output='screen', arguments=[bag, '--rate', rate],
            remappings=[('/tf', 'tf'), ('/tf_static', 'tf_static')]))
    return entities


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments; the team depends on them."""
    return LaunchDescription([
        DeclareLaunchArgument('bags', description='Bags, separated by blanks, one per robot.'),
        DeclareLaunchArgument('rate', default_value='1.0', description='Times real time.'),
        OpaqueFunction(function=start_team),
    ])
