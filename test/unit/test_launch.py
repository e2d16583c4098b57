# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files start what they say, told by the real launch API where that is installed."""

from pathlib import Path
from typing import Any

from helpers import ROOT
import pytest
import yaml

pytest.importorskip('launch_ros', reason='launch comes with a ROS installation only')

import ament_index_python.packages as index  # noqa: E402, I100
from launch import LaunchDescription, LaunchService  # noqa: E402
from launch.actions import ExecuteLocal, IncludeLaunchDescription  # noqa: E402
from launch.launch_description_sources import PythonLaunchDescriptionSource  # noqa: E402

FAKE_SLAM_TOOLBOX = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('slam_params_file'), DeclareLaunchArgument('use_sim_time'),
        Node(package='somfusion_ros', executable='slam_node', name='slam_toolbox', namespace='',
             parameters=[LaunchConfiguration('slam_params_file'),
                         {'use_sim_time': LaunchConfiguration('use_sim_time')}])])
"""


class Started:
    """Processes that would have been started, as command lines."""

    def __init__(self) -> None:
        self.commands: list[list[str]] = []

    def names(self) -> list[tuple[str, str]]:
        """Return namespace and name of every node."""
        return [tuple(next((part.partition(':=')[2] for part in command
                            if part.startswith(f'{word}:=')), '') for word in ('__ns', '__node'))
                for command in self.commands]

    def parameters(self, number: int) -> dict[str, Any]:
        """Merge the parameter files of a node, the later ones last."""
        merged: dict[str, Any] = {}
        command = self.commands[number]
        for flag, path in zip(command, command[1:]):
            if flag == '--params-file':
                for block in yaml.safe_load(Path(path).read_text()).values():
                    block = block.get('slam_toolbox', block)     # below a namespace
                    merged |= block['ros__parameters']
        return merged


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Started:
    """Collect command lines in place of starting processes; the package need not be installed."""
    found = Started()
    toolbox = tmp_path / 'slam_toolbox'
    (toolbox / 'launch').mkdir(parents=True)
    (toolbox / 'launch' / 'online_async_launch.py').write_text(FAKE_SLAM_TOOLBOX)
    share = {'somfusion_ros': str(ROOT), 'slam_toolbox': str(toolbox)}
    monkeypatch.setattr(index, 'get_package_share_directory', share.__getitem__)
    monkeypatch.setattr('launch_ros.substitutions.find_package.get_package_share_directory',
                        share.__getitem__)
    monkeypatch.setattr('launch_ros.substitutions.ExecutableInPackage.perform',
                        lambda self, context: 'executable')

    def execute(action: ExecuteLocal, context: Any) -> None:
        action.process_description.prepare(context, action)
        found.commands.append(list(action.process_description.final_cmd))
    monkeypatch.setattr(ExecuteLocal, 'execute', execute)
    return found


def launch(name: str, **arguments: str) -> int:
    """Launch a file of this package."""
    service = LaunchService(noninteractive=True)
    service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(ROOT / 'launch' / name)),
        launch_arguments=arguments.items())]))
    return service.run()


def test_a_robot_gets_two_nodes_in_its_namespace(started: Started) -> None:
    assert launch('robot.launch.py', namespace='robot1') == 0
    assert started.names() == [('/robot1', 'slam_node'), ('/robot1', 'fusion_node')]
    for number, command in enumerate(started.commands):
        assert {'/tf:=tf', '/tf_static:=tf_static'} <= set(command)
        assert 'use_sim_time' not in started.parameters(number)   # as the parameter file says
    assert started.parameters(0)['resolution'] == 0.05
    assert started.parameters(1)['peers'] == ['']


def test_arguments_reach_the_nodes(started: Started, tmp_path: Path) -> None:
    params = tmp_path / 'own.yaml'
    params.write_text('/**:\n  ros__parameters:\n    resolution: 0.1\n')
    assert launch('robot.launch.py', namespace='fleet/a', peers='b,c', use_sim_time='true',
                  slam_params=str(params), scan_topic='front/scan', log_level='debug') == 0
    assert started.names() == [('/fleet/a', 'slam_node'), ('/fleet/a', 'fusion_node')]
    assert started.parameters(0)['resolution'] == 0.1
    assert started.parameters(0)['use_sim_time'] is True
    assert started.parameters(1)['peers'] == 'b,c'
    assert 'scan:=front/scan' in started.commands[0]
    assert 'debug' in started.commands[1]


@pytest.mark.parametrize(('slam', 'nodes'), [
    ('none', ['fusion_node']), ('slam_toolbox', ['slam_toolbox', 'fusion_node'])])
def test_another_slam_may_make_the_map(slam: str, nodes: list[str], started: Started) -> None:
    assert launch('robot.launch.py', namespace='robot1', slam=slam) == 0
    assert started.names() == [('/robot1', node) for node in nodes]
    if slam == 'slam_toolbox':
        assert {'/map:=map', '/scan:=scan', '/tf:=tf'} <= set(started.commands[0])
        assert started.parameters(0)['scan_topic'] == '/scan'


@pytest.mark.parametrize('given', [
    {'slam': 'magic'}, {'log_level': 'loud'}, {'shared_tf': 'perhaps'}, {'namespace': 'robot 1'},
    {'namespace': '1robot'}, {'namespace': 'robot1//a'}, {'use_sim_time': '1'}])
def test_what_cannot_be_is_refused_before_anything_starts(given: dict[str, str],
                                                          started: Started) -> None:
    assert launch('robot.launch.py', **{'namespace': 'robot1', **given}) != 0
    assert not started.commands


def test_a_parameter_file_stands_unless_an_argument_is_given(started: Started,
                                                             tmp_path: Path) -> None:
    params = tmp_path / 'own.yaml'
    params.write_text('/**:\n  ros__parameters:\n    use_sim_time: true\n'
                      '/**/fusion_node:\n  ros__parameters:\n    peers: [robot2, robot7]\n')
    assert launch('robot.launch.py', namespace='robot1', params_file=str(params)) == 0
    assert all(started.parameters(n)['use_sim_time'] is True for n in (0, 1))
    assert started.parameters(1)['peers'] == ['robot2', 'robot7']
    assert launch('robot.launch.py', namespace='robot1', params_file=str(params),
                  use_sim_time='false', peers='robot3, robot4') == 0
    assert all(started.parameters(n)['use_sim_time'] is False for n in (2, 3))
    assert started.parameters(3)['peers'] == 'robot3, robot4'


def test_robots_that_share_one_tf_get_prefixed_frames(started: Started) -> None:
    assert launch('robot.launch.py', namespace='robot1', shared_tf='true') == 0
    for command in started.commands:
        assert not any(part.startswith('/tf') for part in command)
    slam, fusion = started.parameters(0), started.parameters(1)
    assert (slam['map_frame'], slam['odom_frame'], slam['base_frame']) == (
        'robot1/map', 'robot1/odom', 'robot1/base_link')
    assert (fusion['map_frame'], fusion['world_frame']) == ('robot1/map', 'world')


@pytest.mark.parametrize('text', ['', '/**:\n  ros__parameters: {map_frame: map, mode: mapping}',
                                  'robot1:\n  slam_toolbox:\n    ros__parameters: {}',
                                  '# nothing', '/**:\n  ros__parameters:'])
def test_slam_toolbox_gets_prefixed_frames_whatever_its_file_says(
        text: str, started: Started, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a file says goes before what launch sets beside it; its own default is for no robot."""
    last: list[Any] = []
    monkeypatch.setattr('atexit.register', lambda job, *_, **__: last.append(job) or job)
    own = tmp_path / 'own.yaml'
    own.write_text(text)
    assert launch('robot.launch.py', namespace='robot1', slam='slam_toolbox', shared_tf='true',
                  slam_toolbox_params=str(own) if text else '') == 0
    found = started.parameters(0)
    assert (found['map_frame'], found['odom_frame'], found['base_frame']) == (
        'robot1/map', 'robot1/odom', 'robot1/base_link')
    assert found.get('mode', 'mapping') == 'mapping'
    command = started.commands[0]
    made = Path(command[command.index('--params-file') + 1])
    for job in last:
        if getattr(job, '__self__', None) == made:
            job()
    assert not made.exists(), 'it is of no use once the launch has ended'


def test_a_team_of_any_size(started: Started) -> None:
    assert launch('team.launch.py', robots='a b c', use_sim_time='true') == 0
    assert started.names() == [(f'/{robot}', node) for robot in 'abc'
                               for node in ('slam_node', 'fusion_node')]
    assert all(started.parameters(n)['use_sim_time'] is True for n in range(6))


def test_bags_make_a_team(started: Started) -> None:
    assert launch('replay.launch.py', bags='x/bag ~/bag', rate='2.0',
                  scan_topics='front base') == 0
    assert started.names()[:4] == [(f'/robot{n}', node) for n in (1, 2)
                                   for node in ('slam_node', 'fusion_node')]
    assert started.commands[4][1:12] == [
        'x/bag', str(Path.home() / 'bag'), '--clock', '--rate', '2.0', '--robots', 'robot1',
        'robot2', '--scan-topic', 'front', 'base']
    assert all(started.parameters(n)['use_sim_time'] is True for n in range(4))


@pytest.mark.parametrize(('explore', 'last'), [('false', []), ('true', ['explore_node'])])
def test_nav2_and_its_manager_stand_in_the_namespace(explore: str, last: list[str],
                                                     started: Started) -> None:
    assert launch('navigate.launch.py', namespace='robot1', explore=explore) == 0
    assert started.names() == [('/robot1', node) for node in (
        'controller_server', 'planner_server', 'behavior_server', 'bt_navigator',
        'lifecycle_manager_navigation', *last)]
    assert all('/tf:=tf' in command for command in started.commands)
