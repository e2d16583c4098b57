# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The YAML files name exactly the declared parameters, with their defaults, each explained."""

from dataclasses import fields
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

from helpers import ROOT
import pytest
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.config import TeamConfig
import yaml

# Each node reads its own parameters and those of the core that it drives.
NODES = {'slam.yaml': (SlamConfig, SlamNodeConfig),
         'fusion.yaml': (FusionConfig, TeamConfig, FusionNodeConfig)}


def declared(file_name: str) -> dict[str, Any]:
    """Return name and default of every parameter that the node of a file takes."""
    return {f.name: f.default for c in NODES[file_name] for f in fields(c)}


def written(path: Path) -> dict[str, Any]:
    """Return name and value of every parameter in a file."""
    blocks = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert len(blocks) == 1
    (block,) = blocks.values()
    assert set(block) == {'ros__parameters'}
    return block['ros__parameters']


@pytest.fixture(params=sorted(NODES))
def path(request: pytest.FixtureRequest) -> Path:
    """Visit each file in turn."""
    return ROOT / 'config' / request.param


def test_file_names_exactly_the_declared_parameters(path: Path) -> None:
    assert set(written(path)) == set(declared(path.name))


def test_file_repeats_the_defaults(path: Path) -> None:
    values = declared(path.name)
    for name, value in written(path).items():
        default = values[name]
        if isinstance(default, tuple):
            value = tuple(value)
        assert value == default, name
        assert isinstance(value, bool) == isinstance(default, bool), name
        if isinstance(default, float):
            assert isinstance(value, float), f'{name}: ROS takes {value} for an integer'


def test_every_parameter_has_its_sentence(path: Path) -> None:
    before: list[str] = []
    for line in path.read_text(encoding='utf-8').splitlines():
        key = re.match(r' {2,}(\w+):', line)
        if key and key.group(1) != 'ros__parameters':
            sentence = ' '.join(before) + line.partition('#')[2]
            assert len(sentence.split()) >= 4, f'{key.group(1)} is not explained'
        before = [*before, line.strip(' #')] if line.strip().startswith('#') else []


def test_every_field_of_every_config_is_explained() -> None:
    for config in (c for configs in NODES.values() for c in configs):
        for item in fields(config):
            assert len(item.metadata['description'].split()) >= 4, f'{config}.{item.name}'
            assert item.metadata['description'].endswith('.'), f'{config}.{item.name}'


def test_the_defaults_keep_their_own_ranges() -> None:
    for config in (c for configs in NODES.values() for c in configs):
        config()


def test_a_number_out_of_range_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match='resolution'):
        SlamConfig(resolution=-1.0)


def test_dds_profile_is_well_formed() -> None:
    root = ElementTree.parse(ROOT / 'config' / 'fastdds_wifi.xml').getroot()
    assert '1400' in ''.join(root.itertext())


def test_readme_repeats_the_defaults() -> None:
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    defaults = {**declared('slam.yaml'), **declared('fusion.yaml')}
    checked = 0
    for names, told in re.findall(r'^\| (`\w+`(?:, `\w+`)*) \| ([^|]+) \|', text, re.MULTILINE):
        numbers = [float(number) for number in re.findall(r'\d+(?:\.\d+)?', told)]
        names = [name for name in re.findall(r'\w+', names) if name in defaults]
        if names and len(names) == len(numbers):
            assert [defaults[name] for name in names] == numbers, names
            checked += len(names)
    assert checked >= 5
