# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One robot: a SLAM and the fusion_node in the robot's namespace.

ros2 launch somfusion_ros robot.launch.py namespace:=robot1

With slam:=slam_toolbox its own launch file is included; with slam:=none any other SLAM of the
robot may publish `map`. What a parameter file says stands unless an argument is given for it.
"""

import atexit
from pathlib import Path
import re
from tempfile import NamedTemporaryFile
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (DeclareLaunchArgument, GroupAction, IncludeLaunchDescription,
                            OpaqueFunction)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, PushRosNamespace, SetRemap
import yaml

CONFIG = Path(get_package_share_directory('somfusion_ros')) / 'config'
ARGUMENTS = {
    'namespace': (None, 'Namespace and name of the robot; its peers find it by this name.'),
    'slam': ('slam_node', 'Who makes the map: slam_node, slam_toolbox, or none of them.'),
    'peers': ('', 'Names of the robots to merge with, by commas or blanks; empty: as the '
                  'parameter file says, by default every robot.'),
    'use_sim_time': ('', 'Take the time from /clock; empty: as the parameter file says.'),
    'shared_tf': ('false', 'All robots share one /tf: frames are prefixed with the namespace, and '
                           '/tf is not remapped.'),
    'params_file': ('', 'Parameter file for all nodes, beside and after those below.'),
    'slam_params': (str(CONFIG / 'slam.yaml'), 'Parameter file of slam_node.'),
    'fusion_params': (str(CONFIG / 'fusion.yaml'), 'Parameter file of fusion_node.'),
    'slam_toolbox_params': (str(CONFIG / 'slam_toolbox_robot.yaml'),
                            'Parameter file of slam_toolbox.'),
    'scan_topic': ('scan', "Topic of the robot's laser scans."),
    'odom_topic': ('odom', "Topic of the robot's wheel odometry."),
    'autostart': ('', 'Configure and activate the nodes; false where a lifecycle_manager does '
                      'it; empty: as the parameter file says.'),
    'use_respawn': ('false', 'Start a node again when it ends.'),
    'log_level': ('info', 'How much the nodes say.'),
}
BOOLEANS = ['true', 'false', 'True', 'False']
CHOICES = {'slam': ['slam_node', 'slam_toolbox', 'none'], 'shared_tf': BOOLEANS,
           'use_respawn': BOOLEANS, 'use_sim_time': ['', *BOOLEANS], 'autostart': ['', *BOOLEANS],
           'log_level': ['debug', 'info', 'warn', 'error', 'fatal']}
NAME = re.compile(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*/?')
# A robot's frames stay unprefixed where its transforms stay in its own namespace.
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
RESPAWN_DELAY = 2.0   # [s]


def is_true(text: str) -> bool:
    """Read a boolean argument."""
    return text.lower() == 'true'


def parameters(given: dict[str, str], names: tuple[str, ...]) -> dict[str, Any]:
    """Values of those arguments that were given, as parameters."""
    values: dict[str, Any] = {name: is_true(given[name]) for name in names if given[name]}
    if 'peers' in names:
        values['peers'] = given['peers']
    return values


def frames(given: dict[str, str], names: tuple[str, ...]) -> dict[str, str]:
    """Prefixed frames, where all robots share one /tf."""
    usual = {'map_frame': 'map', 'odom_frame': 'odom', 'base_frame': 'base_link'}
    prefix = given['namespace'].strip('/')
    shared = is_true(given['shared_tf'])
    return {name: f'{prefix}/{usual[name]}' for name in names} if shared else {}


def own_node(name: str, given: dict[str, str], file: str, values: dict[str, Any],
             remappings: list[tuple[str, str]]) -> Node:
    """Describe a node of this package."""
    files = [part for part in (given[file], given['params_file']) if part]
    transforms = [] if is_true(given['shared_tf']) else TRANSFORMS
    return Node(package='somfusion_ros', executable=name, name=name, namespace=given['namespace'],
                output='screen', ros_arguments=['--log-level', given['log_level']],
                parameters=[*files, *([values] if values else [])],
                remappings=[*transforms, *remappings], respawn=is_true(given['use_respawn']),
                respawn_delay=RESPAWN_DELAY)


def set_in_blocks(content: dict[str, Any], values: dict[str, str]) -> None:
    """Set parameters in every block of a parameter file, under however many namespaces."""
    for name, inner in content.items():
        if name == 'ros__parameters':
            content[name] = {**(inner or {}), **values}   # of an empty block nothing is read
        elif isinstance(inner, dict):
            set_in_blocks(inner, values)


def slam_toolbox_file(given: dict[str, str]) -> str:
    """
    Name slam_toolbox's parameter file: one with prefixed frames where all robots share one /tf.

    Its launch file takes one file, and what a file says goes before what launch sets beside it.
    """
    prefixed = frames(given, ('map_frame', 'odom_frame', 'base_frame'))
    file = given['slam_toolbox_params'] or ARGUMENTS['slam_toolbox_params'][0]
    if not prefixed:
        return str(file)
    content = yaml.safe_load(Path(str(file)).read_text(encoding='utf-8')) or {}
    content.setdefault('/**', {'ros__parameters': {}})
    set_in_blocks(content, prefixed)
    with NamedTemporaryFile('w', prefix='slam_toolbox_', suffix='.yaml', delete=False) as made:
        yaml.safe_dump(content, made)
    atexit.register(Path(made.name).unlink, missing_ok=True)   # when the launch ends
    return made.name


def slam_toolbox(given: dict[str, str]) -> GroupAction:
    """Include slam_toolbox; its topics are absolute, so each is put into the namespace."""
    share = Path(get_package_share_directory('slam_toolbox'))
    remaps = [*([] if is_true(given['shared_tf']) else TRANSFORMS), ('/map', 'map'),
              ('/map_metadata', 'map_metadata'), ('/scan', given['scan_topic'])]
    return GroupAction([
        PushRosNamespace(given['namespace']),
        *(SetRemap(src=absolute, dst=relative) for absolute, relative in remaps),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(share / 'launch' / 'online_async_launch.py')),
            launch_arguments={'use_sim_time': given['use_sim_time'] or 'false',
                              'slam_params_file': slam_toolbox_file(given)}.items())])


def start_robot(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Start both; each may be restarted alone."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    if not NAME.fullmatch(given['namespace']):
        raise ValueError(f'namespace {given["namespace"]!r} is no name of a robot: letters, '
                         'digits and _, beginning with a letter, / between parts')
    common = ('use_sim_time', 'autostart')
    slam = {**parameters(given, common),
            **frames(given, ('map_frame', 'odom_frame', 'base_frame'))}
    peers = ('peers',) if given['peers'].strip(', ') else ()
    fusion = {**parameters(given, (*common, *peers)), **frames(given, ('map_frame',))}
    made: list[LaunchDescriptionEntity] = []
    if given['slam'] == 'slam_node':
        made.append(own_node('slam_node', given, 'slam_params', slam,
                             [('scan', given['scan_topic']), ('odom', given['odom_topic'])]))
    elif given['slam'] == 'slam_toolbox':
        made.append(slam_toolbox(given))
    return [*made, own_node('fusion_node', given, 'fusion_params', fusion, [])]


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments; the nodes depend on them."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description,
                                choices=CHOICES.get(name))
          for name, (default, description) in ARGUMENTS.items()),
        OpaqueFunction(function=start_robot)])
