# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Types are strict in the whole package, and users of the package can check against them."""

import configparser
import os
import subprocess
import sys

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest


def test_types_are_strict() -> None:
    pytest.importorskip('mypy')
    result = subprocess.run([sys.executable, '-m', 'mypy', '--cache-dir', os.devnull], cwd=ROOT,
                            capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, f'\n{result.stdout}{result.stderr}'


def test_no_check_is_switched_off() -> None:
    """What third-party packages lack is excused package by package, and nothing else is."""
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg')
    assert set(config['mypy']) == {'packages', 'strict', 'untyped_calls_exclude'}
    assert config['mypy']['packages'] == 'somfusion_ros'
    assert config['mypy'].getboolean('strict')
    for name in (name for name in config.sections() if name.startswith('mypy-')):
        assert set(config[name]) <= {'ignore_missing_imports', 'implicit_reexport'}, name
        assert 'somfusion_ros' not in name


def test_the_types_are_installed() -> None:
    """PEP 561: without this file mypy does not look at an installed package's types."""
    assert (ROOT / 'somfusion_ros' / 'py.typed').exists()
    assert "'py.typed'" in (ROOT / 'setup.py').read_text(encoding='utf-8')
