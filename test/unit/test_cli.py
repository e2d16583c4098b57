# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: help, parameter files, progress on a terminal only."""

import os
from pathlib import Path
import struct
import subprocess
import sys

from helpers import ROOT
import pytest
from somfusion_ros import __version__
from somfusion_ros.cli.main import main
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.io.maps import MapError
from somfusion_ros.io.parameters import make, read_parameters
from somfusion_ros.slam.config import SlamConfig

COMMAND = [sys.executable, '-m', 'somfusion_ros.cli.main']
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}


@pytest.mark.parametrize('command', ['replay', 'merge', 'simulate', 'report'])
def test_help(command: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([command, '--help'])
    assert stopped.value.code == 0
    assert f'usage: somfusion {command}' in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(['--version'])
    assert __version__ in capsys.readouterr().out


def test_progress_bar_on_a_terminal_none_in_a_pipe(tmp_path: Path) -> None:
    fcntl, pty, termios = (pytest.importorskip(name) for name in ('fcntl', 'pty', 'termios'))
    arguments = [*COMMAND, 'simulate', '--robots', '1', '--duration', '3', '--output',
                 str(tmp_path)]
    piped = subprocess.run(arguments, capture_output=True, timeout=60, env=ENVIRONMENT)
    assert (piped.returncode, piped.stderr) == (0, b'')
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 100, 0, 0))
    done = subprocess.run(arguments, stdout=subprocess.PIPE, stderr=theirs, timeout=60,
                          env=ENVIRONMENT)
    os.close(theirs)
    shown = os.read(ours, 65536)
    os.close(ours)
    assert done.returncode == 0
    assert b'robot1' in shown and b'scan/s' in shown


def test_parameter_files_of_the_nodes_are_the_defaults() -> None:
    values = read_parameters([ROOT / 'config' / 'slam.yaml', ROOT / 'config' / 'fusion.yaml'])
    assert make(SlamConfig, values) == SlamConfig()
    assert make(FusionConfig, values) == FusionConfig()


def test_parameter_file(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text('slam_node:\n  ros__parameters:\n    resolution: 0.1\n'
                    'fusion_node:\n  ros__parameters:\n    estimation_confidence: 1\n')
    values = read_parameters([path])
    assert make(SlamConfig, values).resolution == 0.1
    assert make(SlamConfig, values, resolution=0.2).resolution == 0.2
    assert make(FusionConfig, values).estimation_confidence == 1


@pytest.mark.parametrize('text, message', [
    ('resolution: 0.1', 'not a ROS 2 parameter file'),
    ('- 1', 'not a ROS 2 parameter file'),
    ('a: {ros__parameters: {resolutoin: 0.1}}', "no parameter 'resolutoin'"),
])
def test_bad_parameter_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(MapError, match=message) as error:
        read_parameters([path])
    assert str(path) in str(error.value)


@pytest.mark.parametrize('value', ['fine', 0.0, -1])
def test_bad_parameter_value(value: object) -> None:
    with pytest.raises(ValueError, match='resolution'):
        make(SlamConfig, {'resolution': value})
