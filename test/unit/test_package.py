# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package says the same about itself everywhere, and all of it gets installed."""

import ast
import configparser
from importlib import import_module
import os
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

from helpers import ROOT
import pytest
import somfusion_ros
from somfusion_ros.ros.common import names

MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()
SETUP = (ROOT / 'setup.py').read_text(encoding='utf-8')
SCRIPTS = re.findall(r"'(\w+) = ([\w.]+):(\w+)'", SETUP)


def test_package_xml_is_valid() -> None:
    package = pytest.importorskip('catkin_pkg.package')
    warnings: list[str] = []
    parsed = package.parse_package(str(ROOT / 'package.xml'), warnings=warnings)
    parsed.validate(warnings=warnings)
    assert not warnings
    assert parsed.package_format == 3
    assert parsed.get_build_type() == 'ament_python'


def test_package_xml_depends_only_at_run_and_test_time() -> None:
    """Python is not built, so that other kinds of dependency would only pull in more."""
    kinds = {e.tag for e in MANIFEST if e.tag.endswith('depend')}
    assert kinds == {'exec_depend', 'test_depend'}
    names = [e.text for e in MANIFEST if e.tag == 'exec_depend']
    assert names == sorted(set(names))


def imported(*folders: str) -> set[str]:
    """Return the packages of others that files below some folders import while they run."""
    found = set()
    for path in (path for folder in folders for path in (ROOT / folder).rglob('*.py')):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        typing = {id(node) for block in ast.walk(tree) if isinstance(block, ast.If)
                  and 'TYPE_CHECKING' in ast.unparse(block.test) for node in ast.walk(block)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Import) and id(node) not in typing:
                found |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and id(node) not in typing:
                found.add(node.module.split('.')[0])
    return found - sys.stdlib_module_names - {'compression', 'somfusion_ros'}


def is_ros(package: str) -> bool:
    """Tell whether a package comes with ROS."""
    return package.endswith(('_msgs', '_srvs', '_interfaces')) or package in (
        'ament_index_python', 'launch', 'launch_ros', 'rclpy', 'tf2_ros')


def test_the_ros_packages_that_are_imported_are_those_depended_on() -> None:
    named = {e.text for e in MANIFEST if e.tag == 'exec_depend'}
    ros = {package for package in imported('somfusion_ros', 'launch') if is_ros(package)}
    assert {'rclpy', 'launch'} <= ros
    by_name = {'tf2_msgs'}     # which wheels lack: ros/common/optional_types.py looks for it
    assert ros | by_name == {name for name in named if not name.startswith('python3-')}


# What pip installs, by what is imported of it; and the key by which rosdep knows it.
DISTRIBUTIONS = {'backports': 'backports.zstd', 'cv2': 'opencv-python-headless',
                 'kiss_icp': 'kiss-icp', 'yaml': 'pyyaml'}
KEYS = {'opencv-python-headless': 'python3-opencv', 'pyyaml': 'python3-yaml'}
WITHOUT_KEY = {'kiss-icp', 'rosbags', 'backports.zstd', 'lz4'}   # README installs them by pip


def test_what_is_imported_is_what_is_depended_on() -> None:
    """No more, no less, and nothing that only comes along with something else."""
    required = {re.split(r'[; <>=]', text)[0] for text in ast.literal_eval(
        re.search(r'install_requires=(\[.*?\])', SETUP, re.DOTALL).group(1))}
    needed = {DISTRIBUTIONS.get(name, name) for name in imported('somfusion_ros')
              if not is_ros(name)}
    assert needed == required
    keys = {e.text for e in MANIFEST if e.tag == 'exec_depend' and e.text.startswith('python3-')}
    assert keys == {KEYS.get(name, f'python3-{name}') for name in required - WITHOUT_KEY}
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    table = readme[readme.index('## Dependencies'):readme.index('| `ros` extra')]
    by_row = [re.split(', ', row) for row in re.findall(r'^\| ([\w., -]+) \|', table, re.M)]
    assert {name for row in by_row for name in row if name.strip()} == required
    by_pip = re.search(r'^pip install (.*?) "numpy', readme, re.MULTILINE).group(1).split()
    assert set(by_pip) == WITHOUT_KEY


def test_versions_are_equal() -> None:
    in_setup = re.search(r"version='([\d.]+)'", SETUP).group(1)
    changes = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    newest = re.search(r'^(\d+\.\d+\.\d+) \(', changes, re.MULTILINE).group(1)
    citation = (ROOT / 'CITATION.cff').read_text(encoding='utf-8')
    cited = re.search(r'^version: (\S+)$', citation, re.MULTILINE).group(1)
    assert MANIFEST.find('version').text == in_setup == somfusion_ros.__version__ == newest
    assert cited == newest


def test_descriptions_and_licences_agree() -> None:
    assert MANIFEST.find('license').text == 'Apache-2.0'
    assert "license='Apache-2.0'" in SETUP
    assert 'Apache License' in (ROOT / 'LICENSE').read_text(encoding='utf-8')


def test_every_module_lies_in_a_package() -> None:
    """find_packages passes over a folder without __init__.py, and with it all inside."""
    from setuptools import find_packages
    packages = find_packages(str(ROOT), include=['somfusion_ros', 'somfusion_ros.*'])
    found = {p.replace('.', os.sep) for p in packages}
    assert not {p for p in found if not p.startswith('somfusion_ros')}
    modules = (ROOT / 'somfusion_ros').rglob('*.py')
    assert {str(m.parent.relative_to(ROOT)) for m in modules} <= found


@pytest.mark.parametrize('script, module, function', SCRIPTS)
def test_entry_points_import(script: str, module: str, function: str) -> None:
    if module.startswith('somfusion_ros.ros'):
        pytest.importorskip('rclpy')
    assert callable(getattr(import_module(module), function)), script


def test_the_executables_of_the_design_exist() -> None:
    assert {name for name, _, _ in SCRIPTS} == {'slam_node', 'fusion_node', 'player', 'somfusion'}


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda p: p.name)
def test_launch_files_compile_and_describe(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding='utf-8'))
    compile(tree, str(path), 'exec')
    assert 'generate_launch_description' in {n.name for n in tree.body
                                             if isinstance(n, ast.FunctionDef)}


def test_launch_and_config_are_installed() -> None:
    assert list((ROOT / 'launch').glob('*.launch.py'))
    assert list((ROOT / 'config').glob('*.yaml'))
    for share in ('config', 'launch'):
        assert re.search(rf"share/\{{NAME\}}/{share}'", SETUP)


def test_scripts_go_where_ros2_run_looks() -> None:
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg')
    assert config['install']['install_scripts'] == '$base/lib/somfusion_ros'
    assert (ROOT / 'resource' / 'somfusion_ros').exists()


DOCUMENTS = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', ROOT / 'benchmarks' / 'DATASETS.md',
             *sorted((ROOT / 'doc').glob('*.md'))]


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda p: p.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding='utf-8')
    links = re.findall(r'\]\(([^)#\s]+)(?:#[^)]*)?\)', text)
    assert not [link for link in links if not link.startswith('http')
                and not (document.parent / link).exists()]


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda p: p.name)
def test_files_that_documents_name_exist(document: Path) -> None:
    """Names of modules are given below the package, below the root, or beside one another."""
    text = document.read_text(encoding='utf-8')
    named = set(re.findall(r'`((?:[\w.]+/)+[\w.]+\.(?:py|md|yaml|xml|json))`', text))
    roots = (ROOT, ROOT / 'somfusion_ros', ROOT / 'benchmarks', document.parent)
    example = {'fusion/doorways.py', 'test/unit/test_doorways.py'}   # of adding_a_stage.md
    assert not {name for name in named - example
                if not any((root / name).exists() for root in roots)}


def test_benchmarks_that_are_named_exist() -> None:
    """A figure, or a tuned number, can be measured again only where its benchmark is found."""
    sources = [*DOCUMENTS, *(ROOT / 'somfusion_ros').rglob('*.py')]
    named = {name for path in sources for name in
             re.findall(r'benchmarks/[\w/]+\.py', path.read_text(encoding='utf-8'))}
    assert not {name for name in named if not (ROOT / name).exists()}
    modules = {name for path in sources for name in
               re.findall(r'-m (benchmarks(?:\.\w+)+)', path.read_text(encoding='utf-8'))}
    assert not {name for name in modules
                if not (ROOT / f'{name.replace(".", "/")}.py').exists()}


def test_readme_begins_with_the_two_commands() -> None:
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    first = text.index('```sh')
    assert text[first:first + 200].split('\n')[1].startswith('make demo')
    assert text[first:first + 200].split('\n')[2].startswith('make test')


def test_readme_names_every_topic_and_service_of_the_nodes() -> None:
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    known = {value for name, value in vars(names).items()
             if name.isupper() and isinstance(value, str)
             and not name.endswith(('_TYPE', '_SUFFIX'))}
    assert {'scan', 'odom', 'map', 'encounters', '~/reset'} <= known
    told = {name for name in known if not name.startswith('team/')}   # those: doc/team.md
    assert not [name for name in sorted(told) if f'`{name}`' not in text]


def test_ros_names_stand_in_one_place() -> None:
    for path in (ROOT / 'somfusion_ros' / 'ros').rglob('*.py'):
        if path.parent.name != 'apps':   # they are users of the nodes, with names of their own
            literal = re.findall(r"create_(?:publisher|subscription|service)\(\s*\w+,\s*'",
                                 path.read_text(encoding='utf-8'))
            assert not literal, path.name


def test_ci_runs_the_tests_and_nothing_else() -> None:
    path = ROOT / '.ci' / 'run'
    assert os.access(path, os.X_OK)
    lines = [line for line in path.read_text(encoding='utf-8').splitlines()
             if line and not line.startswith('#')]
    assert lines[-1] == 'make oldest test'
    assert len(lines) <= 3


def test_commands_say_how_they_are_used() -> None:
    result = subprocess.run([sys.executable, '-m', 'somfusion_ros.cli.main', '--help'],
                            cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert result.returncode == 0
    for command in ('replay', 'merge', 'simulate', 'report', 'watch'):
        assert command in result.stdout
