# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the parameters of a node came from: files and arguments of its command line."""

from collections.abc import Iterator, Sequence
from pathlib import Path
import re

from somfusion_ros.io.errors import InputError
from somfusion_ros.io.parameters import Block, blocks_of

PARAMETER, FILE = ('-p', '--param'), '--params-file'
PREFIXED = re.compile(r'([^:]+):([^:]+):=')   # the name of a node before that of a parameter


def origin(parameter: str, node: str, arguments: Sequence[str]) -> str:
    """
    Tell where the value of a parameter stands, as `mine.yaml (/**/slam_node)`.

    node: its full name; where nothing on the command line names the parameter, that is told.
    """
    found = node
    for option, value in _options(arguments):
        if option == FILE:
            for block in _blocks(value):
                if parameter in block.values and is_for(block.nodes, node):
                    found = f'{value} ({block.nodes})'
        elif _named(value, parameter, node):
            found = option
    return found


def in_vain(node: str, arguments: Sequence[str]) -> list[str]:
    """
    Name what on the command line gives no parameter to a node, though it looks as if it did.

    Files that have a block for nodes of its name, but not for this one; and `-p name:x:=1`, by
    which ROS means a node of that name in the root namespace.
    """
    said = []
    for option, value in _options(arguments):
        told = PREFIXED.match(value) if option in PARAMETER else None
        if told and not is_for(told[1], node):
            said.append(f'{option} {value} has no effect on {node}: it is for the node '
                        f'/{told[1]}; without {told[1]}: it would be for this one')
        meant = [block for block in _blocks(value) if block.node == node.rpartition('/')[2]
                 ] if option == FILE else []
        if meant and not any(is_for(block.nodes, node) for block in _blocks(value)):
            said.append(f'{value} has no effect on {node}: it is for '
                        f'{", ".join(block.nodes for block in meant)}; /**/{meant[0].node} would '
                        'be for that node in every namespace')
    return said


def is_for(nodes: str, node: str) -> bool:
    """
    Tell whether the name over a block takes in a node, by its full name.

    * stands for one name between slashes, ** for any number, none too.
    """
    pattern = re.escape('/' + nodes.lstrip('/'))
    pattern = pattern.replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(pattern, node) is not None


def _named(assignment: str, parameter: str, node: str) -> bool:
    """Tell whether `x:=1`, or `node:x:=1`, gives a node this parameter."""
    told = PREFIXED.match(assignment)
    if told:
        return told[2] == parameter and is_for(told[1], node)
    return assignment.partition(':=')[0] == parameter


def _options(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the options of ROS that give parameters, and what follows each."""
    for option, value in zip(arguments, arguments[1:]):
        if option == FILE or option in PARAMETER:
            yield option, value


def _blocks(file: str) -> list[Block]:
    """Return the blocks of a file; none where ROS reads it in another way."""
    try:
        return blocks_of(Path(file))
    except InputError:
        return []
