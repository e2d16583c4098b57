# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes' parameter files for the commands: the same numbers offline as live."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TYPE_CHECKING, TypeVar

from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.io.errors import InputError
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.config import TeamConfig
import yaml

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

KNOWN = {item.name for config in (
    SlamConfig, SlamNodeConfig, TeamConfig, FusionConfig, FusionNodeConfig)
         for item in fields(config)}
OWN = ('slam_node', 'fusion_node')
Config = TypeVar('Config', bound='DataclassInstance')


def read_parameters(paths: Iterable[str | Path]) -> dict[str, Any]:
    """
    Read ROS 2 parameter files (`config/slam.yaml`, `config/fusion.yaml`); later ones win.

    Blocks of other nodes, as Nav2's files have them, are passed over. InputError, with one line,
    where a file is none, is for other nodes only, or names a parameter that does not exist.
    """
    values: dict[str, Any] = {}
    for path in paths:
        for name, value in _parameters(Path(path)).items():
            if name not in KNOWN and name != 'use_sim_time':
                raise InputError(f'{path}: there is no parameter {name!r}')
            values[name] = value
    return values


def make(config: type[Config], values: Mapping[str, Any], **more: Any) -> Config:
    """Make a configuration of those values that are its own; ValueError on a bad value."""
    own = {item.name: item.default for item in fields(config)}
    chosen = {name: value for name, value in {**values, **more}.items() if name in own}
    for name, value in chosen.items():
        number = isinstance(own[name], float) and isinstance(value, int)
        if not number and not isinstance(value, type(own[name])):
            raise InputError(f'parameter {name} = {value!r} must be of type '
                             f'{type(own[name]).__name__}')
    return config(**chosen)


def _parameters(path: Path) -> dict[str, Any]:
    """Collect what stands under `ros__parameters` of this package's nodes in a file."""
    try:
        blocks = list(_blocks('', yaml.safe_load(path.read_text())))
        own = [block for node, block in blocks if node in OWN or '*' in node]
        found: dict[str, Any] = {}
        for block in own:
            found |= block or {}
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}') from error
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError,
            yaml.YAMLError) as error:
        raise InputError(f'{path}: not a ROS 2 parameter file') from error
    if not own:
        raise InputError(f'{path}: has no block for {" or ".join(OWN)}, only for '
                         f'{", ".join(node for node, _ in blocks)}')
    return found


def _blocks(node: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """
    Yield the last name of every node in a file, under however many namespaces, and its block.

    KeyError, TypeError or AttributeError where the file is none of ROS 2.
    """
    if 'ros__parameters' in content:
        yield node, content['ros__parameters']
        return
    if not content:
        raise KeyError(node)
    for name, inner in content.items():
        yield from _blocks(name.rpartition('/')[2], inner)
