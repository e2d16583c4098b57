# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""doc/diagnostics.md names all that the nodes count, and nothing else."""

import re

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest
SOURCES = '\n'.join(path.read_text(encoding='utf-8') for path in sorted(
    (ROOT / 'somfusion_ros').rglob('*.py')))
REFERENCE = (ROOT / 'doc' / 'diagnostics.md').read_text(encoding='utf-8')
LISTED = {name for row in re.findall(r'^\| (`.*?) \|', REFERENCE, re.MULTILINE)
          for name in re.findall(r'`(\w+)`', row)}
# A name that is counted or refused under, alone or with a robot's name in it; a key of a status.
COUNTED = (r"(?:count\(|counters\[)\s*f?'([a-z]\w*(?:\{[\w.]+\})?\w*)'",
           r"return '((?:scan|odometry)_\w+)'",
           r"'(seconds_without_\w+)'", r"^    '([a-z_]+)': '(?:a scan|the odometry|it is)")
VALUES = r"'(\w+)': (?:heard|now|sum|snapshot|verdict|connected|rival|last|\(last|sigma|1e3)"


def counted() -> set[str]:
    """Find the names in the sources; X stands for a robot's."""
    found = {name for pattern in COUNTED for name in re.findall(pattern, SOURCES, re.MULTILINE)}
    return {re.sub(r'\{[\w.]+\}', 'X', name) for name in found}


def test_everything_counted_is_in_the_reference() -> None:
    assert len(counted()) > 50
    assert counted() - LISTED == set()


def test_every_value_of_a_status_is_in_the_reference() -> None:
    files = [(ROOT / 'somfusion_ros' / 'ros' / room / 'status.py').read_text(encoding='utf-8')
             for room in ('slam', 'fusion')]
    found = {name for text in files for name in re.findall(VALUES, text)}
    assert len(found) > 20
    assert found - LISTED == set()


@pytest.mark.parametrize('name', sorted(LISTED))
def test_the_reference_names_nothing_else(name: str) -> None:
    for part in re.split(r'X', name):
        part = re.sub(r'^(scan|odometry)_(?=clock_stood|stamps_stray)', '', part)
        part = re.sub(r'^(state|map|clusters|transform|pose|views|bonds)_of_$', '_of_', part)
        part = re.sub(r'^(seconds_without)_(scan|odometry)$', r'\1', part)
        assert part in SOURCES
