# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts for RViz and Foxglove show topics that the nodes have, in the way these need."""

import json
from pathlib import Path
import re

from helpers import ROOT
import pytest
import yaml

LATCHED = ('map', 'global_map', 'clusters')
RVIZ = sorted((ROOT / 'config').glob('*.rviz'))
PUBLISHED = set(re.findall(r'`(?:/<peer>/)?(\w+)`', (ROOT / 'README.md').read_text()))


def last_name(topic: str) -> str:
    """Name of a topic without its namespace."""
    return topic.rpartition('/')[2]


@pytest.mark.parametrize('path', RVIZ, ids=lambda p: p.name)
def test_rviz_shows_topics_that_exist_and_hears_the_latched_ones(path: Path) -> None:
    manager = yaml.safe_load(path.read_text())['Visualization Manager']
    topics = [d['Topic'] for d in manager['Displays'] if 'Topic' in d]
    assert len(topics) >= 6
    for topic in topics:
        assert last_name(topic['Value']) in PUBLISHED, topic
        if last_name(topic['Value']) in LATCHED:
            assert topic['Durability Policy'] == 'Transient Local'
    assert all(d['Class'].startswith('rviz_default_plugins/') for d in manager['Displays'])


def test_one_robot_has_no_name_and_a_team_is_in_the_world() -> None:
    frames = {path.name: yaml.safe_load(path.read_text())['Visualization Manager'][
        'Global Options']['Fixed Frame'] for path in RVIZ}
    assert frames == {'robot.rviz': 'map', 'team.rviz': 'world'}
    assert '/robot' not in (ROOT / 'config' / 'robot.rviz').read_text().partition('\n')[2]


def test_the_layout_of_foxglove_shows_topics_that_exist() -> None:
    layout = json.loads((ROOT / 'config' / 'foxglove_team.json').read_text())
    panels = layout['configById']
    scene = next(panel for name, panel in panels.items() if name.startswith('3D!'))
    assert scene['fixedFrame'] == 'world'
    assert {last_name(topic) for topic in scene['topics']} <= PUBLISHED
    assert {'/robot1/map', '/robot2/map', '/global_map'} <= set(scene['topics'])
    used = json.dumps(layout['layout'])
    assert all(name in used for name in panels)
