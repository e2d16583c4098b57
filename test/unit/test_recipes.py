# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The parameter files of doc/nav2.md, checked against what there is and what the consumers read.

The rules are those of the consumers' sources: which parameters they declare, and of which type;
which frames they look up; which topics they subscribe to, and from which namespace.
"""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
import re
from typing import Any

from helpers import ROOT
import pytest
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.ros.common import names
from somfusion_ros.ros.common.parameter_sets import SETS
import yaml

FRAMES = {'world', 'map', 'odom', 'base_link'}    # of a robot's tree, as this package has them
TOPICS = {names.GLOBAL_MAP, names.MAP, names.SCAN, names.ODOMETRY, 'global_map_updates'}
# Plugins of Nav2 in Jazzy, where every name is written with ::.
PLUGINS = {
    'nav2_controller::SimpleProgressChecker', 'nav2_controller::SimpleGoalChecker',
    'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController',
    'nav2_costmap_2d::StaticLayer', 'nav2_costmap_2d::ObstacleLayer',
    'nav2_costmap_2d::InflationLayer', 'nav2_navfn_planner::NavfnPlanner',
    'nav2_behaviors::Spin', 'nav2_behaviors::BackUp', 'nav2_behaviors::DriveOnHeading',
    'nav2_behaviors::Wait', 'nav2_bt_navigator::NavigateToPoseNavigator',
    'nav2_bt_navigator::NavigateThroughPosesNavigator'}
# Lists of plugins, and of nodes: each entry needs a block, or a node, of its name.
LISTS = ('plugins', 'controller_plugins', 'planner_plugins', 'behavior_plugins', 'navigators',
         'progress_checker_plugins', 'goal_checker_plugins', 'observation_sources')
# What must be a number with a point, or ROS takes it for an integer and the node refuses it.
DOUBLES = re.compile(r'frequency|radius|tolerance|range|period|timeout|factor|scale|size$|'
                     r'interval|resolution|linear_vel|allowance|travel')
# What Nav2 declares as an integer although it is a length.
INTEGERS = {'width', 'height', 'stack_size_to_use'}


def flat(block: dict[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield names with dots, and values, of a block of parameters."""
    for name, value in block.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value


def blocks_of_files() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield file, node pattern and parameters of every recipe, in config/ and in the document."""
    for name in ('nav2_world.yaml', 'explore_world.yaml', 'slam_toolbox_robot.yaml'):
        text = (ROOT / 'config' / name).read_text(encoding='utf-8')
        for node, block in yaml.safe_load(text).items():
            yield name, node, block
    document = (ROOT / 'doc' / 'nav2.md').read_text(encoding='utf-8')
    for number, text in enumerate(re.findall(r'```yaml\n(.*?)```', document, re.DOTALL)):
        for node, block in yaml.safe_load(text).items():
            yield f'nav2.md {number}', node, block


BLOCKS = list(blocks_of_files())
each_block = pytest.mark.parametrize(('file', 'node', 'block'), BLOCKS,
                                     ids=[f'{file} {node}' for file, node, _ in BLOCKS])


@each_block
def test_a_block_is_for_a_node_in_any_namespace(file: str, node: str,
                                                block: dict[str, Any]) -> None:
    assert node.startswith('/**'), 'a plain name matches no node in a namespace'
    assert set(block) == {'ros__parameters'}


@each_block
def test_frames_are_in_the_robots_tree_and_topics_in_its_namespace(file: str, node: str,
                                                                   block: dict[str, Any]) -> None:
    for name, value in flat(block['ros__parameters']):
        last = name.rpartition('.')[2]
        if last.endswith('_frame'):
            assert value in FRAMES, name
        if last == 'map_topic' and 'slam_node' in node:   # another robot's, so in full
            assert re.fullmatch(rf'/robot\d/{names.GLOBAL_MAP}', value)
        elif last.endswith('topic') and file != 'slam_toolbox_robot.yaml':   # remapped at launch
            assert value in TOPICS, name
            assert not value.startswith('/'), f'{name} would leave the namespace'


@each_block
def test_values_have_the_types_that_the_nodes_declare(file: str, node: str,
                                                      block: dict[str, Any]) -> None:
    for name, value in flat(block['ros__parameters']):
        last = name.rpartition('.')[2]
        if last in INTEGERS:
            assert isinstance(value, int), name
        elif DOUBLES.search(last) and not isinstance(value, str):
            assert isinstance(value, float), f'{name}: ROS takes {value!r} for an integer'


@each_block
def test_every_plugin_in_a_list_has_its_block_and_its_type(file: str, node: str,
                                                           block: dict[str, Any]) -> None:
    parameters = dict(flat(block['ros__parameters']))
    for name, value in parameters.items():
        where, _, last = name.rpartition('.')
        if last in LISTS:
            entries = [value] if isinstance(value, str) else value
            for entry in entries:
                inner = f'{where}.{entry}.' if where else f'{entry}.'
                assert any(other.startswith(inner) for other in parameters), entry
        if last == 'plugin':
            assert value in PLUGINS, value


def test_parameters_of_this_package_exist() -> None:
    for _, node, block in BLOCKS:
        own = SETS.get(node.rpartition('/')[2])
        if own:
            known = {item.name for config in own.values() for item in fields(config)}
            assert set(block['ros__parameters']) <= known


def test_the_manager_of_these_nodes_waits_for_no_bond() -> None:
    managed = [block['ros__parameters'] for _, _, block in BLOCKS
               if 'slam_node' in block['ros__parameters'].get('node_names', ())]
    assert managed
    assert all(parameters['bond_timeout'] == 0.0 for parameters in managed)


def test_nobody_asks_for_a_transform_sooner_than_it_is_repeated() -> None:
    slam, fusion = SlamNodeConfig(), FusionNodeConfig()
    assert (slam.transform_publish_period, slam.transform_timeout) == (
        fusion.transform_publish_period, fusion.transform_timeout)
    for _, _, block in BLOCKS:
        for name, value in flat(block['ros__parameters']):
            if name.endswith('transform_tolerance'):
                assert value >= 2.0 * fusion.transform_publish_period
    assert fusion.transform_timeout > 2.0 * fusion.transform_publish_period


def test_nav2_plans_in_the_map_and_frame_of_the_team() -> None:
    by_node = {node: block['ros__parameters'] for file, node, block in BLOCKS
               if file == 'nav2_world.yaml'}
    planner = by_node['/**/global_costmap/global_costmap']
    assert planner['global_frame'] == by_node['/**/bt_navigator']['global_frame'] == 'world'
    static = planner['static_layer']
    assert (static['map_topic'], static['map_subscribe_transient_local']) == ('global_map', True)
    assert planner['track_unknown_space'] is True
    assert 'lethal_cost_threshold' not in planner   # 100: walls are 100
    assert by_node['/**/local_costmap/local_costmap']['global_frame'] == 'odom'   # never jumps
    nodes = {node.split('/')[2] for node in by_node}
    manager = by_node['/**/lifecycle_manager_navigation']
    assert set(manager['node_names']) <= nodes


def test_the_launch_file_starts_what_the_manager_manages() -> None:
    text = (ROOT / 'launch' / 'navigate.launch.py').read_text(encoding='utf-8')
    manager = next(block['ros__parameters'] for _, node, block in BLOCKS
                   if node.endswith('lifecycle_manager_navigation'))
    for name in manager['node_names']:
        assert f"'{name}': 'nav2_" in text


@pytest.mark.parametrize('path', [ROOT / 'config' / 'team.rviz',
                                  ROOT / 'config' / 'foxglove_live.json'], ids=lambda p: p.name)
def test_a_viewer_in_one_robots_tree_shows_only_what_is_in_that_tree(path: Path) -> None:
    """Of another robot's own topics the frame `map` would be taken for this robot's."""
    topics = set(re.findall(r'/robot\d(?:/\w+)+', path.read_text(encoding='utf-8')))
    assert any('/peers/robot2/' in topic for topic in topics)
    assert all(topic.startswith('/robot1/') for topic in topics)
    shown = {topic.rpartition('/')[2] for topic in topics if '/peers/' in topic}
    assert shown <= {names.MAP, names.PATH, names.CLUSTERS}
