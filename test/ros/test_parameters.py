# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters come from the config dataclasses; files, descriptors and live changes agree."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from helpers import need_ros, ROOT
import pytest
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.io.errors import InputError
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.config import TeamConfig
import yaml

need_ros()

import rclpy  # noqa: E402, I100
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from somfusion_ros.ros.common import parameters  # noqa: E402
from somfusion_ros.ros.common.parameter_origin import in_vain, is_for  # noqa: E402
from somfusion_ros.ros.common.parameter_sets import SETS  # noqa: E402
from somfusion_ros.ros.common.parameter_yaml import (FILES, main, parameter_file,  # noqa: E402
                                                     scalar)

CONFIGS = [SlamConfig, SlamNodeConfig, TeamConfig, FusionConfig, FusionNodeConfig]


@pytest.fixture
def context(ros_domain: int) -> Iterator[rclpy.Context]:
    """Return a ROS context that ends with the test."""
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


def make_node(context: rclpy.Context, **overrides: object) -> Node:
    """Make a node with parameters from the command line."""
    return Node('tested', context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in overrides.items()])


@pytest.mark.parametrize('config', CONFIGS, ids=lambda c: c.__name__)
def test_defaults_come_through_ros_unchanged(config: type, context: rclpy.Context) -> None:
    node = make_node(context)
    assert parameters.declare(node, config) == config()
    for item in fields(config):
        described = node.describe_parameter(item.name)
        assert described.description.startswith(item.metadata['description'])
        assert described.read_only != item.metadata['live']
        low = item.metadata['low']
        if low is not None and isinstance(item.default, float):
            assert described.floating_point_range[0].from_value == low
        if low is not None and type(item.default) is int:
            assert described.integer_range[0].from_value == low
    node.destroy_node()


def test_values_from_outside_arrive(context: rclpy.Context) -> None:
    node = make_node(context, laser_pose=[0.1, 0.2, 0.3], odometry_source='encoders')
    config = parameters.declare(node, SlamNodeConfig)
    assert config.laser_pose == (0.1, 0.2, 0.3)
    assert config.odometry_source == 'encoders'
    node.destroy_node()


@pytest.mark.parametrize(('config', 'name', 'value'), [
    (SlamConfig, 'resolution', -1.0), (SlamConfig, 'resolution', float('nan')),
    (SlamConfig, 'resolution', 'fine'), (SlamNodeConfig, 'odometry_source', 'gps'),
    (SlamNodeConfig, 'laser_pose', [1.0]), (FusionNodeConfig, 'merging_rate', 0.0),
    (TeamConfig, 'initial_poses', ['robot1 1 2']), (FusionNodeConfig, 'peers', 3),
    (FusionNodeConfig, 'peers', [1.0]), (FusionConfig, 'seeds', 3.0),
    (SlamNodeConfig, 'laser_pose', [0.0, float('nan'), 0.0]),
    (TeamConfig, 'initial_poses', ['robot1 nan 0 0']), (SlamNodeConfig, 'use_peers', 1)])
def test_bad_values_are_refused_by_name(config: type, name: str, value: object,
                                        context: rclpy.Context) -> None:
    node = make_node(context, **{name: value})
    with pytest.raises(InputError, match=f'/tested: {name} '):
        parameters.declare(node, config)
    node.destroy_node()


@pytest.mark.parametrize(('blocks', 'more', 'told'), [
    ('/**: {ros__parameters: {resolution: 7.0}}', [], 'FILE (/**)'),
    ('robot1: {tested: {ros__parameters: {resolution: 7}}}', [], 'FILE (robot1/tested)'),
    ('/*/tested: {ros__parameters: {resolution: 7.0}}\n'
     'tested: {ros__parameters: {resolution: 8.0}}', [], 'FILE (/*/tested)'),
    ('/**: {ros__parameters: {resolution: 0.1}}', ['-p', 'resolution:=7'], '-p'),
    ('/**: {ros__parameters: {resolution: 0.1}}', ['-p', 'tested:resolution:=7.0'], '-p'),
    ('/**: {ros__parameters: {resolution: 7.0}}', ['-p', 'other:resolution:=0.1'], 'FILE (/**)')])
def test_a_bad_value_is_told_with_where_it_stands(
        blocks: str, more: list[str], told: str, context: rclpy.Context, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(blocks)
    namespace = '/' if 'tested:res' in ' '.join(more) else '/robot1'
    arguments = ['--ros-args', '--params-file', str(path), *more]
    monkeypatch.setattr('sys.argv', ['tested', *arguments])
    node = Node('tested', context=context, namespace=namespace, cli_args=arguments)
    with pytest.raises(InputError) as error:
        parameters.declare(node, SlamConfig)
    assert str(error.value) == (f'{told.replace("FILE", str(path))}: resolution = 7.0 must be a '
                                'number in 0.005..1')
    node.destroy_node()


def test_whole_numbers_serve_where_numbers_are_meant(context: rclpy.Context) -> None:
    """YAML has 5 for 5.0, and the commands take it so."""
    node = make_node(context, laser_pose=[0, 0, 1], map_update_interval=5)
    config = parameters.declare(node, SlamNodeConfig)
    assert (config.laser_pose, config.map_update_interval) == ((0.0, 0.0, 1.0), 5.0)
    assert node.get_parameter('map_update_interval').value == 5.0
    node.destroy_node()


@pytest.mark.parametrize(('nodes', 'meant'), [
    ('/**', True), ('/**/slam_node', True), ('/robot1/slam_node', True), ('/*/slam_node', True),
    ('robot1/slam_node', True), ('slam_node', False), ('/robot2/slam_node', False),
    ('/*', False), ('/**/fusion_node', False), ('/robot1/slam.node', False)])
def test_a_file_with_blocks_for_others_alone_is_named(nodes: str, meant: bool,
                                                      tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(f"'{nodes}': {{ros__parameters: {{resolution: 0.1}}}}")
    assert is_for(nodes, '/robot1/slam_node') == meant
    said = in_vain('/robot1/slam_node', ['node', '--ros-args', '--params-file', str(path)])
    wrong = not meant and nodes.endswith('slam_node')
    assert said == ([f'{path} has no effect on /robot1/slam_node: it is for {nodes}; '
                     '/**/slam_node would be for that node in every namespace'] if wrong else [])


@pytest.mark.parametrize(('namespace', 'name', 'heard'), [
    ('/', 'slam_node', True), ('/robot1', 'slam_node', False), ('/', 'fusion_node', False)])
def test_a_parameter_for_a_node_of_another_name_or_place_is_named(
        namespace: str, name: str, heard: bool, context: rclpy.Context) -> None:
    """`-p slam_node:x:=1` is for /slam_node alone, as ROS itself takes it."""
    arguments = ['--ros-args', '-p', f'{name}:resolution:=0.1', '-p', 'resolution:=0.1',
                 '-p', 'map_file:=/a:b']
    node = Node('slam_node', context=context, namespace=namespace, cli_args=arguments[:3])
    assert ('resolution' in node._parameter_overrides) == heard
    said = in_vain(node.get_fully_qualified_name(), arguments)
    assert said == ([] if heard else [
        f'-p {name}:resolution:=0.1 has no effect on {node.get_fully_qualified_name()}: it is for '
        f'the node /{name}; without {name}: it would be for this one'])
    node.destroy_node()


@pytest.mark.parametrize('given', ['robot2 robot3', 'robot2, robot3', 'robot2,robot3',
                                   ['robot2', 'robot3'], ['robot2,', ' robot3']])
def test_peers_may_be_one_text_or_a_list(given: object, context: rclpy.Context) -> None:
    node = make_node(context, peers=given)
    assert parameters.declare(node, FusionNodeConfig).peers == ('robot2', 'robot3')
    node.destroy_node()


def test_unknown_parameters_are_named_with_the_nearest_that_exist() -> None:
    declared = {'resolution', 'map_frame', 'map_update_interval'}
    said = parameters.unknown(
        ['resolution', 'resolutoin', 'slam.map_frame', 'robot_name', 'xyz', 'use_sim_time',
         'qos_overrides./scan.subscription.depth'], declared, {'fusion_node': ['robot_name']})
    assert said == [
        'there is no parameter resolutoin; did you mean resolution?',
        'robot_name is a parameter of fusion_node, not of this node',
        'there is no parameter slam.map_frame; did you mean map_frame?',
        'there is no parameter xyz']


def test_live_changes_are_taken_all_or_none(context: rclpy.Context) -> None:
    config = FusionConfig()
    changed, result = parameters.change(config, [
        Parameter('estimation_confidence', value=0.8), Parameter('unrelated', value=1)])
    assert result.successful
    assert changed.estimation_confidence == 0.8
    same, result = parameters.change(config, [
        Parameter('estimation_confidence', value=0.8), Parameter('segment_radius', value=-1.0)])
    assert not result.successful
    assert 'segment_radius' in result.reason
    assert same is config


def test_ros_itself_refuses_a_value_out_of_range(context: rclpy.Context) -> None:
    node = make_node(context)
    parameters.declare(node, FusionConfig, changeable=True)
    good, bad = node.set_parameters([Parameter('estimation_confidence', value=v)
                                     for v in (0.5, 1.5)])
    assert good.successful
    assert not bad.successful
    node.destroy_node()


@pytest.mark.parametrize('name', sorted(FILES))
def test_the_files_are_as_written_from_the_config(name: str, tmp_path: Path) -> None:
    main([str(tmp_path)])
    again = (tmp_path / name).read_text()
    assert again == parameter_file(name)
    assert (ROOT / 'config' / name).read_text() == again, (
        'run: python -m somfusion_ros.ros.common.parameter_yaml config')


@pytest.mark.parametrize('value', [1e-5, 1e20, 0.1, 3, True, 'it', -2.5e-7])
def test_yaml_reads_the_same_value_and_type(value: object) -> None:
    again = yaml.safe_load(scalar(value))
    assert again == value
    assert type(again) is type(value)


@pytest.mark.parametrize('name', sorted(FILES))
def test_ros_reads_the_files_in_any_namespace(name: str, context: rclpy.Context) -> None:
    node = Node('any_name', context=context, namespace='/fleet/robot7', cli_args=[
        '--ros-args', '--params-file', str(ROOT / 'config' / name)])
    for config in SETS[FILES[name][0]].values():
        assert parameters.declare(node, config) == config()
    node.destroy_node()


def test_known_poses_are_parsed() -> None:
    config = TeamConfig(initial_poses=('', 'robot1 1 2.5 -0.5'))
    assert config.known_poses() == {'robot1': (1.0, 2.5, -0.5)}
