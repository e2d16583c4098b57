# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags as people really have them: split, compressed, with other metadata or none."""

from contextlib import closing
from pathlib import Path
import re
import shutil
import sqlite3

from helpers import DATA, write_fake_bag
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from somfusion_ros.io.bags.compression import zstd
from somfusion_ros.io.bags.log import BagError, open_log
from somfusion_ros.slam.scan import Scan

CASES = DATA.parent / 'cases' / 'bags'
STORE = get_typestore(Stores.ROS2_JAZZY)


def stamps(path: Path) -> list[float]:
    """Stamps of the scans of a bag."""
    return [record.stamp for record in open_log(path) if isinstance(record, Scan)]


@pytest.fixture(scope='module', params=['mcap', 'sqlite3'])
def good(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a good bag."""
    folder = tmp_path_factory.mktemp('good') / 'run'
    write_fake_bag(folder, storage=request.param, every=4)
    return folder


def rewritten(good: Path, folder: Path, parts: int = 1, mode: CompressionMode | None = None
              ) -> list[Path]:
    """Write the messages of a bag anew, in so many bags, perhaps compressed."""
    with Reader(good) as reader:
        messages = list(reader.messages(reader.connections))
        mcap = any(good.glob('*.mcap'))
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        folders = []
        for number, piece in enumerate(np.array_split(np.arange(len(messages)), parts)):
            folders.append(folder / f'run_{number}')
            writer = Writer(folders[-1], version=9, storage_plugin=plugin)
            if mode is not None:
                writer.set_compression(mode, CompressionFormat.ZSTD)
            with writer:
                made = {c.id: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
                        for c in reader.connections}
                for index in piece:
                    connection, stamp, raw = messages[index]
                    writer.write(made[connection.id], stamp, raw)
    return folders


def storage(folder: Path) -> Path:
    """File with the messages of a bag."""
    return next(f for f in folder.iterdir() if f.name != 'metadata.yaml')


@pytest.mark.parametrize('change', [
    (r'storage_identifier: \w+', "storage_identifier: ''"),
    (r'message_count: \d+', 'message_count: 0'),
    (r'version: 9', 'version: 12'),
    (r'serialization_format: cdr', "serialization_format: ''"),
    (r'storage_identifier: \w+', 'storage_identifier: rosbag_v2')])
def test_metadata_that_leads_nowhere(good: Path, tmp_path: Path, change: tuple[str, str]) -> None:
    folder = shutil.copytree(good, tmp_path / 'bag')
    text = (folder / 'metadata.yaml').read_text()
    changed = re.sub(*change, text)
    assert changed != text
    (folder / 'metadata.yaml').write_text(changed)
    assert stamps(folder) == stamps(good)
    assert 'metadata.yaml cannot be used' in open_log(folder).notes[0]


@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('metadata', [True, False])
def test_compressed(good: Path, tmp_path: Path, mode: CompressionMode, metadata: bool) -> None:
    if mode is CompressionMode.MESSAGE and any(good.glob('*.mcap')):
        pytest.skip('mcap compresses chunks')
    (folder,) = rewritten(good, tmp_path, mode=mode)
    if not metadata:
        (folder / 'metadata.yaml').unlink()
    assert stamps(folder) == stamps(good)


def test_a_compressed_file_alone(good: Path, tmp_path: Path) -> None:
    file = storage(good)
    packed = tmp_path / f'{file.name}.zstd'
    packed.write_bytes(zstd.compress(file.read_bytes()))
    assert stamps(packed) == stamps(good)


def test_split_without_metadata(good: Path, tmp_path: Path) -> None:
    """Eleven parts: the tenth comes after the ninth, not after the first."""
    folder = tmp_path / 'bag'
    folder.mkdir()
    for number, part in enumerate(rewritten(good, tmp_path, parts=11)):
        shutil.copy(storage(part), folder / f'bag_{number}{storage(part).suffix}')
    assert stamps(folder) == stamps(good)


def test_files_of_two_bags_in_a_folder_are_not_one(good: Path, tmp_path: Path) -> None:
    for name in ('one', 'other'):
        shutil.copy(storage(good), tmp_path / f'{name}{storage(good).suffix}')
    with pytest.raises(BagError, match='files of several bags'):
        open_log(tmp_path)


def test_a_folder_of_bags_names_one_of_them(good: Path, tmp_path: Path) -> None:
    """Also where each robot has a folder with the bag in it, as `simulate` writes them."""
    shutil.copytree(good, tmp_path / 'all' / 'robot1' / 'bag')
    with pytest.raises(BagError, match='name those that it holds, such as .*all/robot1$'):
        open_log(tmp_path / 'all')
    shutil.copytree(good, tmp_path / 'all' / 'day')
    with pytest.raises(BagError, match='such as .*all/day$'):
        open_log(tmp_path / 'all')


def test_a_split_recording_whose_last_part_is_cut_off(tmp_path: Path) -> None:
    write_fake_bag(tmp_path / 'good', every=4)
    folder = tmp_path / 'bag'
    folder.mkdir()
    for number, part in enumerate(rewritten(tmp_path / 'good', tmp_path, parts=3)):
        data = storage(part).read_bytes()
        (folder / f'bag_{number}.mcap').write_bytes(data[:len(data) // (1 + (number == 2))])
    found, whole = stamps(folder), stamps(tmp_path / 'good')
    assert found == whole[:len(found)]
    assert len(found) > 0.7 * len(whole)
    assert 'mcap recover' in open_log(folder).notes[0]


@pytest.mark.parametrize(('case', 'least'), [('cut', 310), ('storage_id_empty', 399)])
def test_the_shared_samples(case: str, least: int) -> None:
    if not (CASES / case).exists():
        pytest.skip('the shared samples are not on this machine (set SOMFUSION_DATA)')
    assert len(stamps(CASES / case)) >= least


def test_what_a_killed_recorder_left_in_the_journal_is_read(tmp_path: Path) -> None:
    """A stranger's bag came with its `.db3-wal`; half of such a bag was silently left out."""
    write_fake_bag(tmp_path / 'run', storage='sqlite3', every=4)
    whole = stamps(tmp_path / 'run')
    with closing(sqlite3.connect(storage(tmp_path / 'run'))) as base:
        rows = base.execute('SELECT * FROM messages ORDER BY id').fetchall()
        base.execute('PRAGMA journal_mode=WAL')
        base.execute('PRAGMA wal_autocheckpoint=0')
        base.execute('DELETE FROM messages')
        base.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows[:100])
        base.commit()
        base.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        base.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows[100:])
        base.commit()
        shutil.copytree(tmp_path / 'run', tmp_path / 'killed')
    before = {file: file.read_bytes() for file in (tmp_path / 'killed').iterdir()}
    assert stamps(tmp_path / 'killed') == whole
    assert stamps(next((tmp_path / 'killed').glob('*.db3'))) == whole
    assert {file: file.read_bytes() for file in (tmp_path / 'killed').iterdir()} == before
