# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a ROS reviewer's linters would say, and the header of every file."""

from pathlib import Path
import re
import subprocess
import sys

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest
FOLDERS = ['somfusion_ros', 'test', 'benchmarks', 'launch', 'scripts']
FILES = sorted([ROOT / 'setup.py', *(f for d in FOLDERS for f in (ROOT / d).rglob('*.py'))])
HEADER = ('# Copyright 2026 The somfusion_ros authors\n'
          '# SPDX-License-Identifier: Apache-2.0\n')
PLUGINS = ('flake8_builtins', 'flake8_comprehensions', 'flake8_docstrings',
           'flake8_import_order', 'flake8_quotes')


def test_flake8() -> None:
    """Uses the plug-ins that ament_flake8 uses, among them pep257's rules, where installed."""
    pytest.importorskip('flake8')
    result = subprocess.run([sys.executable, '-m', 'flake8', *map(str, FILES)], cwd=ROOT,
                            capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, f'\n{result.stdout}{result.stderr}'


@pytest.mark.parametrize('plugin', PLUGINS)
def test_flake8_has_its_plugins(plugin: str) -> None:
    pytest.importorskip(plugin)


@pytest.mark.parametrize('path', FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_header_then_docstring(path: Path) -> None:
    text = path.read_text(encoding='utf-8')
    assert text.startswith(HEADER)
    assert text[len(HEADER):].lstrip().startswith('"""')


@pytest.mark.parametrize('path', FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_nothing_left_over(path: Path) -> None:
    """A release holds no unfinished marks and no code in comments."""
    text = path.read_text(encoding='utf-8')
    marks = '|'.join(['TO' + 'DO', 'FIX' + 'ME', 'X' + 'XX'])
    assert not re.search(rf'\b({marks})\b', text)
    assert not re.search(r'^\s*# *(def |class |import |return |if .*:$)', text, re.MULTILINE)
