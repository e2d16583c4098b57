# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The examples in docstrings are true."""

import doctest
from importlib import import_module

from helpers import ROOT
import pytest

PACKAGE = ROOT / 'somfusion_ros'
WITH_EXAMPLES = sorted('.'.join(path.relative_to(ROOT).with_suffix('').parts)
                       for path in PACKAGE.rglob('*.py')
                       if '>>> ' in path.read_text(encoding='utf-8'))


def test_there_are_examples() -> None:
    assert 'somfusion_ros.fusion.alignment' in WITH_EXAMPLES


@pytest.mark.parametrize('name', WITH_EXAMPLES)
def test_examples_of(name: str) -> None:
    """Every example gives what it says."""
    tried = doctest.testmod(import_module(name))
    assert tried.attempted > 0 and tried.failed == 0
