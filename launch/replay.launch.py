# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A team out of recorded logs: per bag a slam_node and a fusion_node, and one player for all.

ros2 launch somfusion_ros replay.launch.py bags:="first second" rate:=2.0

All nodes live in the time of the recording, which the player publishes on /clock, and every
robot's tree is whole: world -> map -> odom -> base_link -> laser. RViz joins in with
`--ros-args -p use_sim_time:=true`.
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
    bags = [str(Path(bag).expanduser())   # which no shell does within quotes
            for bag in LaunchConfiguration('bags').perform(context).split()]
    rate = LaunchConfiguration('rate').perform(context)
    topics: list[str] = []
    for name in ('scan', 'odom'):
        given = LaunchConfiguration(f'{name}_topics').perform(context).split()
        topics += [f'--{name}-topic', *given] if given else []
    robots = [f'robot{number}' for number in range(1, len(bags) + 1)]
    passed_on = {name: LaunchConfiguration(name) for name in ('params_file', 'log_level')}
    # A source of its own: a description that was loaded once can be launched only once.
    return [*(IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(ROBOT)),
        launch_arguments={'namespace': name, 'use_sim_time': 'true', **passed_on}.items())
        for name in robots),
        Node(package='somfusion_ros', executable='player', name='player', output='screen',
             arguments=[*bags, '--clock', '--rate', rate, '--robots', *robots, *topics])]


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments; the team depends on them."""
    return LaunchDescription([
        DeclareLaunchArgument('bags', description='Bags, separated by blanks, one per robot.'),
        DeclareLaunchArgument('rate', default_value='1.0', description='Times real time.'),
        *(DeclareLaunchArgument(
            f'{name}_topics', default_value='',
            description=f'Topics of {what} in the bags, where there are several: one for all, or '
            'one for each.') for name, what in (('scan', 'the scans'), ('odom', 'odometry'))),
        DeclareLaunchArgument('params_file', default_value='',
                              description='Parameter file for all nodes.'),
        DeclareLaunchArgument('log_level', default_value='info',
                              description='How much the nodes say.'),
        OpaqueFunction(function=start_team),
    ])
