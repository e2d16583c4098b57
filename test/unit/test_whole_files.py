# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A full disk never leaves half a file: what was there stays, and nothing is left beside it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
import resource

from matplotlib.figure import Figure
import numpy as np
import pytest
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import write_map
from somfusion_ros.io.result import write_result, write_robot_map
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.report.pictures import write_figure
from somfusion_ros.whole_files import write_files

SMALL = Grid(np.array([[1.0, -1.0], [0.0, 1.0]]), 0.05)
LARGE = Grid(np.random.default_rng(1).uniform(-1.0, 1.0, (40, 40)), 0.05)


@contextmanager
def files_of(largest: int) -> Iterator[None]:
    """Let no file that this process writes become larger [bytes]."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize('write', [
    lambda folder, large: write_map(folder, LARGE if large else SMALL),
    lambda folder, large: write_robot_map(folder, LARGE if large else SMALL),
    lambda folder, large: write_tum(folder / 'a.tum', *(np.zeros((999 if large else 1, n))
                                                        for n in (1, 3))),
    lambda folder, large: write_result(folder, {'robots': 'x' * (9999 if large else 1)}),
    lambda folder, large: write_figure(folder / 'a.png', Figure(), dpi=200 if large else 10),
], ids=['map', 'robot map', 'trajectory', 'result', 'figure'])
def test_a_full_disk_leaves_what_was_there(tmp_path: Path,
                                           write: Callable[[Path, bool], object]) -> None:
    write(tmp_path, False)
    before = contents(tmp_path)
    with files_of(1000), pytest.raises(OSError):
        write(tmp_path, True)
    assert contents(tmp_path) == before
    write(tmp_path, True)
    assert contents(tmp_path).keys() == before.keys() and contents(tmp_path) != before


def test_a_file_that_cannot_be_written_keeps_those_with_it(tmp_path: Path) -> None:
    paths = tmp_path / 'a', tmp_path / 'b'
    write_files(dict.fromkeys(paths, b'old'))
    with files_of(10), pytest.raises(OSError):
        write_files({paths[0]: b'new', paths[1]: b'far too long'})
    assert contents(tmp_path) == {'a': b'old', 'b': b'old'}


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / 'link').symlink_to('file')
    write_files({tmp_path / 'link': b'new'})
    assert (tmp_path / 'link').is_symlink() and (tmp_path / 'file').read_bytes() == b'new'


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """By its own name, not by that of its draft."""
    for path in (tmp_path / 'missing' / 'map.pgm', tmp_path):
        with pytest.raises(OSError) as error:
            write_files({path: b'map'})
        assert error.value.filename == str(path)
    with files_of(2), pytest.raises(OSError, match='map.pgm'):
        write_files({tmp_path / 'map.pgm': b'map'})
    assert contents(tmp_path) == {}
