# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The examples in docstrings do what they show."""

import doctest
from importlib import import_module
from pathlib import Path

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest     # numpy 1 and 2 write some numbers in other words
PACKAGE = ROOT / 'somfusion_ros'
WITH_EXAMPLES = [path for path in sorted(PACKAGE.rglob('*.py'))
                 if '>>> ' in path.read_text(encoding='utf-8')]


@pytest.mark.parametrize('path', WITH_EXAMPLES, ids=lambda p: p.stem)
def test_examples(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What an example writes goes into an empty folder."""
    monkeypatch.chdir(tmp_path)
    name = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
    if name.startswith('somfusion_ros.ros.'):
        pytest.importorskip('rclpy')
    tried = doctest.testmod(import_module(name), optionflags=doctest.ELLIPSIS)
    assert tried.attempted
    assert not tried.failed
