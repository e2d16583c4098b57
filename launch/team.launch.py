# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Several robots on one machine, as in a simulation; real robots start robot.launch.py each.

ros2 launch somfusion_ros team.launch.py robots:="robot1 robot2 robot3" use_sim_time:=true
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

ROBOT = Path(get_package_share_directory('somfusion_ros')) / 'launch' / 'robot.launch.py'
# For every robot; what they mean and may be is said and checked in robot.launch.py.
PASSED_ON = {'use_sim_time': '', 'slam': 'slam_node', 'shared_tf': 'false', 'params_file': '',
             'autostart': '', 'use_respawn': 'false', 'log_level': 'info'}


def start_team(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Start every robot in a namespace of its name."""
    robots = LaunchConfiguration('robots').perform(context).replace(',', ' ').split()
    if len(set(robots)) < len(robots):
        raise ValueError(f'robots {" ".join(robots)}: two of them have one name')
    passed_on = {name: LaunchConfiguration(name) for name in PASSED_ON}
    # A source of its own: a description that was loaded once can be launched only once.
    return [IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(ROBOT)),
        launch_arguments={'namespace': name, **passed_on}.items()) for name in robots]


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments; the team depends on them."""
    return LaunchDescription([
        DeclareLaunchArgument('robots', default_value='robot1 robot2',
                              description='Names of the robots, by blanks or commas.'),
        *(DeclareLaunchArgument(name, default_value=default,
                                description=f'{name} of every robot, see robot.launch.py.')
          for name, default in PASSED_ON.items()),
        OpaqueFunction(function=start_team),
    ])
