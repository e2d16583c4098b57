# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes' parameter files for the commands: the same numbers offline as live."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING, TypeVar

from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.io.errors import InputError
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.settings import SettingError, taken
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.config import TeamConfig
import yaml

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

CONFIGS: tuple[type, ...] = (SlamConfig, SlamNodeConfig, TeamConfig, FusionConfig,
                             FusionNodeConfig)
KNOWN = {item.name for config in CONFIGS for item in fields(config)}
OWN = ('slam_node', 'fusion_node')
# Of every node, without a meaning for a command.
ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
Config = TypeVar('Config', bound='DataclassInstance')


class Block(NamedTuple):
    """Parameters in a file, and for which nodes they are as it says, such as `/**/slam_node`."""

    nodes: str
    values: Mapping[str, Any]

    @property
    def node(self) -> str:
        """Last name of the nodes."""
        return self.nodes.rpartition('/')[2]


def read_parameters(paths: Sequence[str | Path]) -> dict[str, Any]:
    """
    Read ROS 2 parameter files (`config/slam.yaml`, `config/fusion.yaml`); later ones win.

    Blocks of other nodes, as Nav2's files have them, are passed over. InputError, with one line
    that names the file, where a file is none, is for other nodes only, names a parameter that
    does not exist, or gives one a value that it cannot have.
    """
    values: dict[str, Any] = {}
    places: dict[str, str] = {}
    for path in paths:
        for block in _own_blocks(Path(path)):
            place = f'{path} ({block.nodes})'
            for name, value in block.values.items():
                if name not in KNOWN and name.partition('.')[0] not in ROS_OWN:
                    raise InputError(f'{place}: there is no parameter {name!r}')
                values[name], places[name] = value, place
    for config in CONFIGS:
        try:
            make(config, values)
        except SettingError as error:
            place = places.get(error.name, ', '.join(map(str, paths)))
            raise InputError(f'{place}: {error}') from error
    return values


def make(config: type[Config], values: Mapping[str, Any], **more: Any) -> Config:
    """Make a configuration of those values that are its own; SettingError on a bad value."""
    given = {**values, **more}
    return config(**{item.name: taken(item, given[item.name])
                     for item in fields(config) if item.name in given})


def blocks_of(path: Path) -> list[Block]:
    """Return all blocks of a ROS 2 parameter file; InputError, with one line, if it is none."""
    try:
        blocks = [Block(nodes, values or {})
                  for nodes, values in _blocks('', yaml.safe_load(path.read_text()))]
        if all(isinstance(block.values, dict) for block in blocks):
            return blocks
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}') from error
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError,
            yaml.YAMLError) as error:
        raise InputError(f'{path}: not a ROS 2 parameter file') from error
    raise InputError(f'{path}: not a ROS 2 parameter file')


def _own_blocks(path: Path) -> list[Block]:
    """Return the blocks of a file that are for nodes of this package."""
    blocks = blocks_of(path)
    own = [block for block in blocks if block.node in OWN or '*' in block.node]
    if not own:
        raise InputError(f'{path}: has no block for {" or ".join(OWN)}, only for '
                         f'{", ".join(block.nodes for block in blocks)}')
    return own


def _blocks(nodes: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """
    Yield the name of every node in a file, under however many namespaces, and its block.

    KeyError, TypeError or AttributeError where the file is none of ROS 2.
    """
    if 'ros__parameters' in content:
        yield nodes, content['ros__parameters']
        return
    if not content:
        raise KeyError(nodes)
    for name, inner in content.items():
        yield from _blocks(f'{nodes}/{name}' if nodes else name, inner)
