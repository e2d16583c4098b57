# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every tuned number stands once, with its unit, its reason and where it was measured."""

import ast
from collections import defaultdict
from dataclasses import fields
from importlib import util
from types import ModuleType

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest
STAGES = ('slam', 'fusion', 'team')
# Rooms whose stages still hold numbers beside their settings; this list only ever gets shorter.
UNFINISHED = ('slam', 'fusion')


def script() -> ModuleType:
    """Load the script that writes the document."""
    spec = util.spec_from_file_location('make_constants', ROOT / 'scripts' / 'make_constants.py')
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def numbers(room: str) -> dict[str, dict[str, str]]:
    """Collect module-level names in capitals that hold fractional numbers, by name and file."""
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for path in sorted((ROOT / 'somfusion_ros' / room).rglob('*.py')):
        for node in ast.parse(path.read_text(encoding='utf-8')).body:
            if not isinstance(node, ast.Assign):
                continue
            names = [n.id for t in node.targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            fractional = any(isinstance(n, ast.Constant) and isinstance(n.value, float)
                             for n in ast.walk(node.value))
            for name in names:
                if name.isupper() and fractional:
                    found[name][path.name] = ast.unparse(node.value)
    return found


def test_every_tuned_number_says_why_and_where() -> None:
    for module, item in script().tunings():
        for entry in fields(item):
            where = f'{module}.{item.__name__}.{entry.name}'
            assert len(entry.metadata.get('reason', '').split()) >= 3, where
            assert entry.metadata.get('measured'), where
            assert 'unit' in entry.metadata, where


def test_the_document_is_the_code() -> None:
    text = (ROOT / 'doc' / 'constants.md').read_text(encoding='utf-8')
    assert text == script().document(), 'run: python scripts/make_constants.py'


@pytest.mark.parametrize('room', [room for room in STAGES if room not in UNFINISHED])
def test_no_stage_hides_a_number(room: str) -> None:
    assert not numbers(room)


@pytest.mark.parametrize('room', [room for room in STAGES if room not in UNFINISHED])
def test_no_number_stands_twice(room: str) -> None:
    assert not {name: places for name, places in numbers(room).items() if len(places) > 1}
