# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rooms and the arrows between them stay as designed, and no file grows into a maze."""

import ast
from collections import Counter
from functools import cache
from pathlib import Path
import re
import subprocess
import sys

from helpers import ROOT
import pytest

PACKAGE = ROOT / 'somfusion_ros'
FILES = sorted(PACKAGE.rglob('*.py'))
MAX_FILE_LINES, MAX_FUNCTION_LINES = 250, 60
# Arrows run from a higher floor to a lower one, or stay inside one room.
FLOORS = {'settings': 0, 'geometry': 0, 'whole_files': 0, 'node_config': 1, 'grid': 1, 'slam': 2,
          'fusion': 2, 'team': 3, 'io': 4, 'simulation': 5, 'report': 5, 'offline': 6, 'cli': 7,
          'ros': 7}
STAGES = {
    'slam': {'motion', 'matching', 'ekf', 'loops', 'mapping'},
    'fusion': {'segmentation', 'som', 'normals', 'orientation', 'translation', 'measures'},
}
CORE = tuple(room for room in FLOORS if room not in ('ros',))
ROS_NAMES = {
    'rclpy', 'rcl_interfaces', 'tf2_ros', 'ament_index_python', 'launch', 'launch_ros',
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'sensor_msgs',
    'std_msgs', 'std_srvs', 'tf2_msgs', 'visualization_msgs'}


def name_of(path: Path) -> str:
    """Return the dotted name of a file below the package, without the package's own."""
    parts = path.relative_to(PACKAGE).with_suffix('').parts
    return '.'.join(p for p in parts if p != '__init__')


def room_of(module: str) -> str:
    """Return the first part of a dotted name: a package or a module of the ground floor."""
    return module.split('.')[0]


@cache
def tree_of(path: Path) -> ast.Module:
    """Parse a file once."""
    return ast.parse(path.read_text(encoding='utf-8'))


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Return the dotted names that a file imports at run time, anywhere in it."""
    skipped = {id(n) for block in ast.walk(tree_of(path)) if isinstance(block, ast.If)
               and 'TYPE_CHECKING' in ast.unparse(block.test) for n in ast.walk(block)}
    found = set()
    for node in ast.walk(tree_of(path)):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path.name}: relative import'
            found |= {f'{node.module}.{alias.name}' for alias in node.names}
    return frozenset(found)


def own_imports(path: Path) -> set[str]:
    """Return the names of this package's modules that a file imports."""
    modules = {name_of(f) for f in FILES} - {''}
    inner = {n.removeprefix('somfusion_ros.') for n in imports_of(path)
             if n.startswith('somfusion_ros.')}
    return {max((m for m in modules if n == m or n.startswith(f'{m}.')), key=len)
            for n in inner if room_of(n) in FLOORS}


def functions_of(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Return every function and method of a file."""
    return [n for n in ast.walk(tree_of(path))
            if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef))]


each_file = pytest.mark.parametrize('path', FILES, ids=lambda p: name_of(p) or 'package')


@each_file
def test_arrows_run_one_way(path: Path) -> None:
    here = room_of(name_of(path))
    if here not in FLOORS:
        return
    for target in own_imports(path):
        there = room_of(target)
        assert there == here or FLOORS[there] < FLOORS[here], f'{here} imports {target}'


@each_file
def test_stages_never_import_one_another(path: Path) -> None:
    room, _, stage = name_of(path).partition('.')
    if stage not in STAGES.get(room, ()):
        return
    others = {f'{r}.{s}' for r, names in STAGES.items() for s in names} - {f'{room}.{stage}'}
    assert not own_imports(path) & others


def test_every_stage_of_the_design_has_its_room() -> None:
    missing = [f'{room}/{stage}.py' for room, names in STAGES.items() for stage in names
               if not (PACKAGE / room / f'{stage}.py').exists()]
    assert not missing


def test_imports_make_no_ring() -> None:
    graph = {name_of(f): own_imports(f) - {name_of(f)} for f in FILES}
    while True:
        leaves = {name for name, targets in graph.items() if not targets & graph.keys()}
        if not leaves:
            break
        graph = {name: targets for name, targets in graph.items() if name not in leaves}
    assert not graph, f'these import one another: {sorted(graph)}'


def test_the_document_shows_every_room() -> None:
    text = (ROOT / 'doc' / 'architecture.md').read_text(encoding='utf-8')
    assert not {room for room in FLOORS if not re.search(rf'\b{room}\b', text)}


@each_file
def test_core_names_no_ros(path: Path) -> None:
    if room_of(name_of(path)) in CORE:
        assert not {n.split('.')[0] for n in imports_of(path)} & ROS_NAMES


@pytest.mark.slow
def test_core_and_commands_import_where_ros_is_absent() -> None:
    modules = [f'somfusion_ros.{name_of(f)}' for f in FILES if room_of(name_of(f)) in CORE]
    code = f"""
import importlib, sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {sorted(ROS_NAMES)!r}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, NoRos())
for name in {modules!r}:
    importlib.import_module(name)
"""
    result = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True,
                            text=True, timeout=120)
    assert result.returncode == 0, result.stderr[-2000:]


def test_what_is_defined_is_used() -> None:
    """By whatever is here; ROS itself calls the steps of a life cycle, and logging `emit`."""
    folders = ('somfusion_ros', 'benchmarks', 'scripts', 'launch', 'test')
    sources = {path: path.read_text(encoding='utf-8')
               for folder in folders for path in (ROOT / folder).rglob('*.py')}
    words = Counter(word for text in (*sources.values(), (ROOT / 'setup.py').read_text())
                    for word in re.findall(r'\w+', text))
    defined = {node.name if isinstance(node, (ast.FunctionDef, ast.ClassDef)) else node.id
               for path in FILES for node in ast.walk(tree_of(path))
               if isinstance(node, (ast.FunctionDef, ast.ClassDef))
               or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))}
    called = {name for name in defined if name.startswith(('on_', '__'))} | {'emit'}
    assert not {name for name in defined - called if words[name] == 1}


def test_few_files_know_rclpy() -> None:
    knowing = {name_of(f) for f in FILES   # apps are sensors and users of the nodes
               if any(n.split('.')[0] == 'rclpy' for n in imports_of(f))
               and not name_of(f).startswith('ros.apps')}
    assert len(knowing) <= 4, sorted(knowing)


@each_file
def test_library_never_prints(path: Path) -> None:
    calls = [n.lineno for n in ast.walk(tree_of(path)) if isinstance(n, ast.Call)
             and isinstance(n.func, ast.Name) and n.func.id == 'print']
    assert not calls, f'print in lines {calls}'


@each_file
def test_files_and_functions_stay_short(path: Path) -> None:
    lines = len(path.read_text(encoding='utf-8').splitlines())
    assert lines <= MAX_FILE_LINES
    long = {f.name: f.end_lineno - f.lineno + 1 for f in functions_of(path)
            if f.end_lineno - f.lineno + 1 > MAX_FUNCTION_LINES}
    assert not long


@each_file
def test_every_signature_has_hints(path: Path) -> None:
    bare = []
    for function in functions_of(path):
        args = function.args
        named = [*args.posonlyargs, *args.args, *args.kwonlyargs, args.vararg, args.kwarg]
        unhinted = [a.arg for a in named if a is not None and a.annotation is None
                    and a.arg not in ('self', 'cls')]
        if unhinted or function.returns is None:
            bare.append(f'{function.name} (line {function.lineno}): {unhinted or "return"}')
    assert not bare


@each_file
def test_everything_public_has_a_docstring(path: Path) -> None:
    tree = tree_of(path)
    classes = [n for n in tree.body if isinstance(n, ast.ClassDef)]
    nodes = [tree, *(n for owner in (tree, *classes) for n in owner.body
                     if isinstance(n, (ast.FunctionDef, ast.ClassDef)))]
    bare = [getattr(n, 'name', 'module') for n in nodes
            if not getattr(n, 'name', '').startswith('_') and not ast.get_docstring(n)]
    assert not bare
