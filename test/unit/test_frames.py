# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a robot is called, and how its frames are, in its own tree and in one for all."""

import pytest
from somfusion_ros.ros.common.names import MAP_TYPE, STATE_TYPE, TEAM_STATE
from somfusion_ros.ros.common.peers import find_peers
from somfusion_ros.ros.fusion.frames import Frames, team_prefix


@pytest.mark.parametrize(('namespace', 'robot', 'prefix'), [
    ('/robot1', 'robot1', ''), ('/fleet/robot1', 'fleet/robot1', ''), ('/', 'robot1', '/robot1/')])
def test_the_others_find_a_robot_under_its_own_name(namespace: str, robot: str,
                                                    prefix: str) -> None:
    assert team_prefix(namespace, robot) == prefix
    topic = f'{prefix or namespace + "/"}{TEAM_STATE}'
    graph = [(topic, [STATE_TYPE]), (f'{namespace.rstrip("/")}/map', [MAP_TYPE])]
    assert find_peers(graph, TEAM_STATE, STATE_TYPE, '/other/team/state', ()) == [robot]
    # In the root namespace its plain map must not make a second robot of it.
    assert set(find_peers(graph, 'map', MAP_TYPE, '/other/map', ())) <= {robot}


@pytest.mark.parametrize(('namespace', 'robot', 'words'), [
    ('/', '', 'root namespace'), ('/robot1', 'other', 'would find this robot as')])
def test_a_name_that_nobody_would_find_is_refused(namespace: str, robot: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        team_prefix(namespace, robot)


def test_frames_in_a_tree_of_its_own_and_in_one_for_all() -> None:
    own, shared = Frames('robot1', 'map', 'world'), Frames('robot1', 'robot1/map', 'world')
    assert (own.shared, own.map_of('robot1'), own.map_of('robot2')) == (False, 'map', 'robot2/map')
    assert (shared.shared, shared.map_of('robot1'), shared.map_of('robot2')) == (
        True, 'robot1/map', 'robot2/map')
