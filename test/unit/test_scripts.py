# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the set-up makes by itself fails with a line, not with a traceback, and never hangs."""

from importlib import util
from pathlib import Path
import subprocess

from helpers import ROOT
import pytest

pytestmark = pytest.mark.newest


@pytest.mark.parametrize(('fault', 'told'), [
    (subprocess.TimeoutExpired('cmake', 900), 'timed out after 900 seconds'),
    (FileNotFoundError(2, 'No such file', 'cmake'), "No such file: 'cmake'"),
    (subprocess.CalledProcessError(1, 'cmake', output='no compiler\n'), 'no compiler')])
def test_why_tf2_msgs_cannot_be_made_is_said(
        fault: Exception, told: str, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    spec = util.spec_from_file_location('make_tf2_msgs', ROOT / 'scripts' / 'make_tf2_msgs.py')
    script = util.module_from_spec(spec)
    spec.loader.exec_module(script)

    def run(*_: object, timeout: float, **__: object) -> None:
        raise fault
    monkeypatch.setattr(script, 'find_spec', lambda name: None)
    monkeypatch.setattr(script.sys, 'prefix', str(tmp_path))
    monkeypatch.setattr(script.subprocess, 'run', run)
    assert script.main() == 1
    error = capsys.readouterr().err
    assert told in error and 'tf2_msgs could not be made' in error
