# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write config/*.yaml from the config dataclasses, so that words and defaults stand only there.

`python -m somfusion_ros.ros.common.parameter_yaml config` renews both files after a change.
"""

import argparse
from dataclasses import Field, fields
from pathlib import Path
from textwrap import wrap
from typing import Any

from somfusion_ros.ros.common.parameter_sets import SETS
from somfusion_ros.settings import span
from somfusion_ros.whole_files import write_text

WIDTH = 95
INDENT = ' ' * 4
FILES = {
    'slam.yaml': (
        'slam_node', 'Parameters of slam_node. You do not need this file: these are the defaults. '
        'Copy the lines that you change. The wildcard takes the node in any namespace, so one '
        'file serves every robot. Those of the SLAM, and those marked live, can be changed while '
        'the node runs (ros2 param set); the others are read at the start.'),
    'fusion.yaml': (
        'fusion_node', 'Parameters of fusion_node. You do not need this file: these are the '
        'defaults. Copy the lines that you change. Those of the merge of two maps, and those '
        'marked live, can be changed while the node runs (ros2 param set); the others are read '
        'at the start.'),
}


def parameter_file(name: str) -> str:
    """Return the text of one YAML file."""
    node, introduction = FILES[name]
    lines = [*comment(introduction, ''), '/**:', '  ros__parameters:']
    for title, config in SETS[node].items():
        lines += ['', f'{INDENT}# ---- {title} ----']
        for item in fields(config):
            lines += ['', *comment(sentence(item), INDENT),
                      f'{INDENT}{item.name}: {scalar(item.default)}']
    return '\n'.join(lines) + '\n'


def sentence(item: Field[Any]) -> str:
    """Describe a parameter: effect, unit, range, and whether it can change live."""
    meta = item.metadata
    notes = [note for note in (meta['unit'], span(item), 'live' if meta['live'] else '') if note]
    return str(meta['description']) + (f' [{"; ".join(notes)}]' if notes else '')


def comment(text: str, indent: str) -> list[str]:
    """Break a text into comment lines."""
    return [f'{indent}# {line}' for line in wrap(text, WIDTH - len(indent))]


def scalar(value: Any) -> str:
    """Write a value so that ROS reads the same type again."""
    if isinstance(value, tuple):
        return f'[{", ".join(scalar(item) for item in value)}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value}'"
    text = repr(value)
    return text.replace('e', '.0e') if 'e' in text and '.' not in text else text


def main(arguments: list[str] | None = None) -> int:
    """Write the files into a folder."""
    parser = argparse.ArgumentParser(prog='parameter_yaml', description=(
        f'Write {" and ".join(FILES)} anew, from the settings in the code.'))
    parser.add_argument('folder', metavar='DIR', type=Path, help='such as config')
    folder: Path = parser.parse_args(arguments).folder
    if not folder.is_dir():
        parser.error(f'{folder}: there is no such folder')
    for name in FILES:
        write_text(folder / name, parameter_file(name))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
