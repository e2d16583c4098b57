# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion replay --state` goes on in an earlier map, `--localize` tracks a robot in one."""

import json
from pathlib import Path
import shutil
from typing import Any

from helpers import pose_error, write_fake_bag
import numpy as np
import pytest
from somfusion_ros.cli.main import main
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.slam.checkpoint_file import load_checkpoint

pytestmark = pytest.mark.slow

OTHER_WAY = np.array([(6.8, 2.8), (4.0, 3.0), (1.5, 4.6), (1.2, 2.0), (3.5, 1.0)])


@pytest.fixture(scope='module')
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Array]:
    """Replay a bag; return its result, a bag of another way, and where that starts in the map."""
    folder = tmp_path_factory.mktemp('first')
    poses = [write_fake_bag(folder / 'a', every=2),
             write_fake_bag(folder / 'b', waypoints=OTHER_WAY, every=2)]
    assert main(['replay', str(folder / 'a'), '--state', str(folder / 'state'), '--no-report',
                 '--output', str(folder / 'out')]) in (0, None)
    return folder, folder / 'b', between(poses[0][0], poses[1][0])


def replayed(bag: Path, output: Path, *options: str) -> dict[str, Any]:
    """Replay a bag by the command; return its result."""
    command = ['replay', str(bag), '--no-report', '--output', str(output), *options]
    assert main(command) in (0, None)
    record = json.loads((output / 'result.json').read_text())
    assert record['found_after_m'] == record['robots']['robot1']['found_after_m']
    return record


def assert_in_map(record: dict[str, Any], output: Path, start: Array, bag: Path) -> None:
    """Assert that the robot was found, and that its trajectory is in the map's frame."""
    assert 0.0 < record['found_after_m'] < 5.0
    found = np.array([record['found_transform'][key] for key in ('x', 'y', 'theta')])
    metres, radians = pose_error(found, start)
    assert metres < 0.1
    assert radians < 0.03
    stamps, poses = read_tum(output / 'robot1' / 'trajectory.tum')
    alone = bag.parent / 'alone'
    if not alone.exists():
        replay_alone = ['replay', str(bag), '--no-report', '--output', str(alone)]
        assert main(replay_alone) in (0, None)
    own_stamps, own = read_tum(alone / 'robot1' / 'trajectory.tum')
    k = np.searchsorted(own_stamps, stamps[-1])
    assert pose_error(poses[-1], compose(start, own[k]))[0] < 0.1


def test_a_run_goes_on_in_the_map_of_another_day(
        first: tuple[Path, Path, Array], tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    folder, bag, start = first
    state = tmp_path / 'state'
    state.write_bytes((folder / 'state').read_bytes())
    before = load_checkpoint(state)
    record = replayed(bag, tmp_path / 'out', '--state', str(state))
    assert_in_map(record, tmp_path / 'out', start, bag)
    assert f'after {record["found_after_m"]:.1f} m' in capsys.readouterr().out
    alone = json.loads((bag.parent / 'alone' / 'result.json').read_text())
    driven = record['robots']['robot1']['distance']     # of this run, not of all the map's views
    assert driven == pytest.approx(alone['robots']['robot1']['distance'], rel=0.05)
    after = load_checkpoint(state)
    assert len(after.trail) > len(before.trail)
    assert pose_error(after.poses[5], before.poses[5])[0] < 0.05
    stamps, poses = read_tum(tmp_path / 'out' / 'robot1' / 'trajectory.tum')
    assert pose_error(poses[0], start)[0] < 0.1     # what was driven before it was found, too


@pytest.mark.parametrize('map_file', ['state', 'out/robot1/map.yaml'])
def test_a_robot_is_tracked_in_a_map(map_file: str, first: tuple[Path, Path, Array],
                                     tmp_path: Path) -> None:
    folder, bag, start = first
    before = (folder / map_file).read_bytes()
    record = replayed(bag, tmp_path / 'out', '--localize', str(folder / map_file))
    assert_in_map(record, tmp_path / 'out', start, bag)
    stamps, _ = read_tum(tmp_path / 'out' / 'robot1' / 'trajectory.tum')
    assert stamps[0] >= record['found_at']
    assert (folder / map_file).read_bytes() == before


def test_a_state_is_begun_where_there_is_none(first: tuple[Path, Path, Array],
                                              tmp_path: Path) -> None:
    record = replayed(first[1], tmp_path / 'out', '--state', str(tmp_path / 'new'))
    assert record['found_after_m'] is None
    assert len(load_checkpoint(tmp_path / 'new').poses) > 5


def test_one_flipped_bit_of_a_state_costs_neither_the_map_nor_the_start(
        first: tuple[Path, Path, Array], tmp_path: Path) -> None:
    folder, bag, start = first
    data = bytearray((folder / 'state').read_bytes())
    data[len(data) // 3] ^= 4
    (tmp_path / 'state').write_bytes(data)
    record = replayed(bag, tmp_path / 'out', '--state', str(tmp_path / 'state'))
    assert_in_map(record, tmp_path / 'out', start, bag)
    assert 'state_damaged' in ' '.join(record['robots']['robot1']['notes'])


@pytest.mark.parametrize(('options', 'words'), [
    (['--localize', 'nowhere.yaml'], 'nowhere.yaml'), (['--localize', 'nowhere'], 'nowhere'),
    (['--localize', 'text'], 'not a usable checkpoint'),
    (['--state', 'text'], 'not a usable checkpoint'),
    (['--localize', 'out/map.yaml'], 'would overwrite')])
def test_what_cannot_be_used_is_named_in_one_line(
        options: list[str], words: str, first: tuple[Path, Path, Array], tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path('text').write_text('this is no state')
    shutil.copytree(first[0] / 'out', 'out')
    assert main(['replay', str(first[1]), '--output', 'out', *options]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert '\n' not in error


def test_a_state_is_for_one_robot(first: tuple[Path, Path, Array], tmp_path: Path,
                                  capsys: pytest.CaptureFixture[str]) -> None:
    bag = str(first[1])
    assert main(['replay', bag, bag, '--output', str(tmp_path / 'out'), '--state',
                 str(tmp_path / 'state')]) == 2
    assert 'one robot' in capsys.readouterr().err
