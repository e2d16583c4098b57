# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the services of the nodes write: never two robots into one file, always told in full."""

from pathlib import Path
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import pytest
from somfusion_ros.ros.common.saved_files import file_stem, requested_name

namespaces = st.lists(st.from_regex(r'[a-z]{1,5}[0-9]', fullmatch=True), max_size=3).map('/'.join)


@given(namespaces, namespaces, st.sampled_from(['map', 'global_map']))
def test_no_robot_overwrites_the_file_of_another(one: str, other: str, kind: str) -> None:
    first, second = (file_stem('/maps', '', f'/{name}', kind) for name in (one, other))
    assert (first == second) == (one == other)
    assert first.parent == Path('/maps')
    assert first.name.endswith(kind)


@pytest.mark.parametrize(('directory', 'name', 'expected'), [
    ('/maps', '', '/maps/fleet_robot1_map'), ('/maps', 'lab', '/maps/lab'),
    ('/maps', 'lab.yaml', '/maps/lab'), ('/maps', 'a/b.npz', '/maps/a/b'),
    ('/maps', '/other/lab', '/other/lab'), ('~/maps', 'lab', '{home}/maps/lab'),
    ('/maps', '~/lab.pgm', '{home}/lab'), ('.', 'lab', '{here}/lab')])
def test_paths_are_told_in_full(directory: str, name: str, expected: str) -> None:
    found = file_stem(directory, name, '/fleet/robot1', 'map')
    assert str(found) == expected.format(home=Path.home(), here=Path.cwd())


def test_a_robot_in_the_root_namespace_has_the_plain_name() -> None:
    assert file_stem('/maps', '', '/', 'map') == Path('/maps/map')


@pytest.mark.parametrize('name', ['rooms/', '/', '.yaml'])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match='names no file'):
        file_stem('/maps', name, '/robot1', 'map')


def test_what_nav2_asks_for_is_done_or_refused() -> None:
    asked = SimpleNamespace(map_url='lab', image_format='pgm', map_mode='trinary')
    assert requested_name(asked) == 'lab'
    with pytest.raises(ValueError, match='png'):
        requested_name(SimpleNamespace(map_url='lab', image_format='png', map_mode=''))
