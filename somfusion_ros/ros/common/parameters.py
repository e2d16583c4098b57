# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters declared from the config dataclasses: defaults and descriptions live there."""

from collections.abc import Iterable, Mapping
from dataclasses import Field, fields, replace
from difflib import get_close_matches
import sys
from typing import Any, TYPE_CHECKING, TypeVar

from rcl_interfaces.msg import (FloatingPointRange, IntegerRange, ParameterDescriptor,
                                SetParametersResult)
from somfusion_ros.io.errors import InputError
from somfusion_ros.ros.common.parameter_origin import in_vain, origin
from somfusion_ros.ros.common.parameter_sets import names_of, SETS
from somfusion_ros.settings import SettingError, taken

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Config = TypeVar('Config', bound='DataclassInstance')
UNBOUNDED = {float: 1e308, int: 2 ** 62}   # rcl ranges have two ends
ROS_OWN = ('use_sim_time', 'start_type_description_service')
ROS_PREFIXES = ('qos_overrides.',)


def declare(node: Any, config_class: type[Config], changeable: bool = False) -> Config:
    """
    Declare every field of a config dataclass as a parameter and read the values that came in.

    InputError on a bad value: one line that names the file or the argument it stands in, the
    parameter, the value, and what is allowed.
    """
    values = {}
    try:
        for item in fields(config_class):
            _take_override(node, item)
            value = node.declare_parameter(item.name, _to_ros(item.default),
                                           descriptor(item, changeable)).value
            values[item.name] = taken(item, value)
        return config_class(**values)
    except SettingError as error:
        place = origin(error.name, node.get_fully_qualified_name(), sys.argv)
        raise InputError(f'{place}: {error}') from error


def _take_override(node: Any, item: Field[Any]) -> None:
    """Check a value that came in before rclpy does, which takes no 5 for 5.0."""
    given = node._parameter_overrides.get(item.name)   # rclpy has no public way to ask
    if given is not None:
        value = _to_ros(taken(item, given.value))
        node._parameter_overrides[item.name] = type(given)(item.name, value=value)


def descriptor(item: Field[Any], changeable: bool) -> ParameterDescriptor:
    """Describe a config field: sentence, unit, range; read-only unless it may change live."""
    meta = item.metadata
    unit = f' [{meta["unit"]}]' if meta['unit'] else ''
    result = ParameterDescriptor(name=item.name, description=meta['description'] + unit,
                                 read_only=not (changeable or meta['live']),
                                 dynamic_typing=meta['words'])
    kind = type(item.default)
    bounded = meta['low'] is not None or meta['high'] is not None
    if bounded and kind in UNBOUNDED:
        low = meta['low'] if meta['low'] is not None else -UNBOUNDED[kind]
        high = meta['high'] if meta['high'] is not None else UNBOUNDED[kind]
        if kind is float:
            result.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            result.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return result


def change(config: Config, parameters: list[Any]) -> tuple[Config, SetParametersResult]:
    """
    Apply live changes to a config, all or none.

    Parameters that the config does not have are left to others; a refusal says why.
    """
    known = {item.name: item for item in fields(config)}
    try:
        changed = {p.name: taken(known[p.name], p.value)
                   for p in parameters if p.name in known}
        return replace(config, **changed), SetParametersResult(successful=True)
    except (TypeError, ValueError) as error:
        return config, SetParametersResult(successful=False, reason=str(error))


def unknown(given: Iterable[str], declared: Iterable[str],
            elsewhere: Mapping[str, Iterable[str]]) -> list[str]:
    """
    Name every parameter that was given but does not exist, with the nearest one that does.

    Parameters
    ----------
    given : names that came from the command line and from files
    declared : names of the node's own parameters
    elsewhere : names of the parameters of other nodes, by node
    """
    own, said = set(declared) | set(ROS_OWN), []
    for name in sorted(set(given) - own):
        owner = next((node for node, names in elsewhere.items() if name in set(names)), None)
        near = get_close_matches(name, own, 1) or [
            last for last in [name.rpartition('.')[2]] if last in own]
        if name.startswith(ROS_PREFIXES):
            continue
        if owner:
            said.append(f'{name} is a parameter of {owner}, not of this node')
        elif near:
            said.append(f'there is no parameter {name}; did you mean {near[0]}?')
        else:
            said.append(f'there is no parameter {name}')
    return said


def warn_of_unknown(node: Any) -> None:
    """Log every parameter and file that was given to a node but is of no use to it."""
    own = node.get_name() if node.get_name() in SETS else ''
    elsewhere = {other: names_of(other) for other in SETS if other != own}
    for sentence in unknown(node._parameter_overrides, node.get_parameters_by_prefix(''),
                            elsewhere):
        node.get_logger().warning(sentence)
    for sentence in in_vain(node.get_fully_qualified_name(), sys.argv):
        node.get_logger().warning(sentence)


def _to_ros(value: Any) -> Any:
    """Convert a tuple to the list that ROS knows."""
    return list(value) if isinstance(value, tuple) else value
