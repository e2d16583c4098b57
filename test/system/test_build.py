# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package builds as a wheel, as a source archive and under colcon, and all of it arrives."""

from importlib.util import find_spec
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tarfile
from zipfile import ZipFile

from helpers import ROOT
import pytest

pytestmark = [pytest.mark.system, pytest.mark.newest]
PARTS = ('somfusion_ros', 'config', 'launch', 'resource', 'test', 'setup.py', 'setup.cfg',
         'package.xml', 'README.md', 'CHANGELOG.rst', 'LICENSE', 'MANIFEST.in', 'Makefile', 'doc',
         'benchmarks', 'scripts', '.ci', 'CONTRIBUTING.md', 'CITATION.cff')
EXECUTABLES = {'fusion_node', 'player', 'slam_node', 'somfusion'}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Copy what a checkout holds, so that nothing is built among the sources."""
    folder = tmp_path / 'src' / 'somfusion_ros'
    folder.mkdir(parents=True)
    for part in PARTS:
        path = ROOT / part
        if path.is_dir():
            shutil.copytree(path, folder / part, ignore=shutil.ignore_patterns('__pycache__'))
        else:
            shutil.copy(path, folder / part)
    return folder


def do(folder: Path, *command: str) -> str:
    """Run a command; fail with its words."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300,
                          env={**os.environ, 'PYTHONPATH': ''})
    assert done.returncode == 0, f'{" ".join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}'
    return done.stdout


def modules() -> set[str]:
    """Return the path of every file of the package: modules, and what they read."""
    return {str(path.relative_to(ROOT)) for path in (ROOT / 'somfusion_ros').rglob('*')
            if path.is_file() and '__pycache__' not in path.parts}


def test_wheel_and_source_archive_hold_the_package(source: Path) -> None:
    pytest.importorskip('build')
    do(source, sys.executable, '-m', 'build', '--no-isolation', '--outdir', 'dist')
    (wheel,), (archive,) = (source / 'dist').glob('*.whl'), (source / 'dist').glob('*.tar.gz')
    names = set(ZipFile(wheel).namelist())
    assert modules() <= names
    assert not [name for name in names if name.startswith('test')]
    shared = {name.partition('/data/')[2] for name in names if '/data/share/' in name}
    assert {'share/somfusion_ros/launch/robot.launch.py', 'share/somfusion_ros/config/slam.yaml',
            'share/somfusion_ros/package.xml'} <= shared
    with tarfile.open(archive) as packed:
        inside = {name.partition('/')[2] for name in packed.getnames()}
    assert modules() | {'setup.py', 'Makefile', 'doc/architecture.md', 'test/support/helpers.py',
                        'benchmarks/figures.py', 'scripts/make_constants.py'} <= inside


def test_colcon_builds_and_tests_the_package(source: Path) -> None:
    if find_spec('colcon_core') is None or find_spec('colcon_ros') is None:
        pytest.skip('colcon is not installed')
    workspace = source.parent.parent
    colcon = (str(Path(sys.executable).with_name('colcon')),)
    do(workspace, *colcon, 'build', '--event-handlers', 'console_direct+')
    prefix = workspace / 'install' / 'somfusion_ros'
    assert {path.name for path in (prefix / 'lib' / 'somfusion_ros').iterdir()} == EXECUTABLES
    share = prefix / 'share' / 'somfusion_ros'
    for folder in ('config', 'launch'):
        assert {p.name for p in (share / folder).iterdir()} >= {
            p.name for p in (ROOT / folder).glob('*.*')}
    said = do(workspace, str(prefix / 'lib' / 'somfusion_ros' / 'somfusion'), '--version')
    assert said.startswith('somfusion ')
    do(workspace, *colcon, 'test', '--pytest-args', 'test/unit/test_geometry.py')
    result = do(workspace, *colcon, 'test-result', '--verbose')
    assert ' 0 errors, 0 failures' in result


def test_installed_packages_fit_one_another() -> None:
    """On CI every package is looked at; elsewhere others may have been there before."""
    done = subprocess.run([sys.executable, '-m', 'pip', 'check'], capture_output=True, text=True,
                          timeout=120)
    said = done.stdout.splitlines()
    assert not [line for line in said if line.startswith('somfusion')]
    assert done.returncode == 0 or 'CI' not in os.environ, done.stdout
