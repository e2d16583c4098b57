# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion replay` end to end on small bags of two robots in one room."""

from collections import Counter
import json
import os
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from helpers import fake_room, fake_scan, pose_error, ROOT, write_fake_bag
import numpy as np
import pytest
from somfusion_ros.geometry import between
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.io.maps import read_map
from somfusion_ros.io.trajectories import read_tum, write_tum
from somfusion_ros.offline.replay import JOINT_FILES, replay, ReplayOptions, save_joint
from somfusion_ros.offline.robot_run import paired
from somfusion_ros.slam.pairing import Pairing

pytestmark = pytest.mark.slow

OTHER_WAY = np.array([(6.8, 2.8), (4.0, 3.0), (1.5, 4.6), (1.2, 2.0), (3.5, 1.0)])
PAIR_KEYS = {'target', 'source', 'accepted', 'probability', 'reason', 'transform',
             'verification_index', 'performance_index', 'overlap', 'runner_up', 'seconds'}


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], np.ndarray]:
    """Write bags of two robots in one room; give them and the true T_robot1_robot2."""
    folder = tmp_path_factory.mktemp('bags')
    poses = [write_fake_bag(folder / 'a', every=2),
             write_fake_bag(folder / 'b', waypoints=OTHER_WAY, every=2)]
    return [folder / 'a', folder / 'b'], between(poses[0][0], poses[1][0])


@pytest.fixture(scope='module')
def result(bags: tuple[list[Path], np.ndarray],
           tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Replay both bags in this process, without pictures."""
    folder = tmp_path_factory.mktemp('result')
    replay(bags[0], folder, ReplayOptions(jobs=1, pictures=False))
    return folder, json.loads((folder / 'result.json').read_text())


def test_the_maps_are_placed_right(result: tuple[Path, dict], bags: tuple) -> None:
    _, record = result
    assert record['unconnected'] == []
    found = [np.array([record['transforms'][robot][key] for key in ('x', 'y', 'theta')])
             for robot in ('robot1', 'robot2')]
    assert found[0] == pytest.approx(np.zeros(3))
    distance, angle = pose_error(found[1], bags[1])
    assert distance < 0.15
    assert angle < np.radians(2.0)


def test_the_result_is_as_designed(result: tuple[Path, dict]) -> None:
    _, record = result
    assert len(record['pairs']) == 1
    pair = record['pairs'][0]
    assert PAIR_KEYS <= pair.keys()
    assert (pair['target'], pair['source'], pair['accepted']) == ('robot1', 'robot2', True)
    assert 0.0 <= pair['probability'] <= 1.0
    assert 50.0 < pair['verification_index'] <= 100.0
    assert record['verification_index'] == pytest.approx(pair['verification_index'], abs=3.0)
    assert pair['performance_index'] and all(j >= 0 for j in pair['performance_index'])
    assert all(seconds >= 0 for seconds in pair['seconds'].values())


def test_every_robot_has_its_files(result: tuple[Path, dict], bags: tuple) -> None:
    folder, record = result
    for robot, bag in zip(('robot1', 'robot2'), bags[0]):
        about = record['robots'][robot]
        stamps, poses = read_tum(folder / robot / 'trajectory.tum')
        views = read_tum(folder / robot / 'views.tum')[0]
        assert len(stamps) >= about['scans'] >= open_log(bag).scan_count - 1
        assert (np.diff(stamps) > 0).all(), 'scans and the odometry between them, in order'
        assert 1 < len(views) == about['views'] < len(stamps)
        assert np.isin(np.round(views, 6), np.round(stamps, 6)).all()
        assert read_map(folder / robot / 'map.yaml').occupied.sum() > 100
        assert about['real_time_factor'] > 0
        assert about['milliseconds_per_scan']['median'] <= about['milliseconds_per_scan']['p99']
        assert about['counters']['scans'] >= about['scans']


def test_the_global_map_holds_both(result: tuple[Path, dict]) -> None:
    folder, _ = result
    whole = read_map(folder / 'map.yaml')
    parts = [read_map(folder / robot / 'map.yaml') for robot in ('robot1', 'robot2')]
    area = [grid.known.sum() * grid.resolution ** 2 for grid in (whole, *parts)]
    assert area[0] > max(area[1:]) - 0.5


def test_one_robot_alone(bags: tuple, tmp_path: Path) -> None:
    record = replay(bags[0][:1], tmp_path)
    assert record['pairs'] == record['unconnected'] == []
    assert (record['map_of'], record['map_note']) == (['robot1'], '')
    assert record['transforms'] == {'robot1': {'x': 0.0, 'y': 0.0, 'theta': 0.0}}
    assert record['verification_index'] is None
    assert (tmp_path / 'map.yaml').exists()


@pytest.mark.slow
def test_command_in_a_pipe_and_in_processes(result: tuple[Path, dict], bags: tuple,
                                            tmp_path: Path) -> None:
    """One process per robot changes nothing; without a terminal only results are written."""
    folder, record = result
    done = subprocess.run(
        [sys.executable, '-m', 'somfusion_ros.cli.main', 'replay', str(bags[0][0]),
         str(bags[0][1]), '--output', str(tmp_path), '--no-report', '--jobs', '2'],
        capture_output=True, text=True, timeout=300,
        env={**os.environ, 'PYTHONPATH': str(ROOT)})
    assert (done.returncode, done.stderr) == (0, '')
    for word in ('robot1: ', 'times real time', 'robot1 <- robot2: accepted', 'world -> robot2'):
        assert word in done.stdout
    again = json.loads((tmp_path / 'result.json').read_text())
    assert again['transforms'] == record['transforms']
    for name in ('robot1/trajectory.tum', 'robot2/views.tum', 'robot2/map.pgm', 'map.pgm'):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize('late, expected', [(0.0, 5), (0.3, 5), (2.0, 4)])
def test_scans_after_the_last_odometry(tmp_path: Path, late: float, expected: int) -> None:
    """The last scan of a log often comes after the last odometry: its twist reaches there."""
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(5):
            stamp = 10.0 + 0.1 * number
            bag.odometry(stamp, (0.05 * number, 0.0, 0.0), (0.5, 0.0, 0.0))
            bag.scan(fake_scan(fake_room(), (2.0, 2.0, 0.0), stamp + late * (number == 4)))
    counters: Counter[str] = Counter()
    pairing = Pairing(1e9, lambda name, reason='': counters.update([name]))
    pairs = list(paired(open_log(tmp_path / 'bag'), pairing))
    assert len(pairs) == expected
    assert counters['scans_without_odometry'] == 5 - expected
    last = pairs[-1]
    assert last[1].stamp == last[0].stamp
    assert last[1].pose[0] == pytest.approx(0.5 * (last[0].stamp - 10.0))


def test_tum_roundtrip(tmp_path: Path) -> None:
    stamps = np.array([1600000000.123456, 1600000000.223456])
    poses = np.array([[1.0, -2.0, 3.1], [0.5, 0.25, -3.1]])
    write_tum(tmp_path / 'a.tum', stamps, poses)
    back = read_tum(tmp_path / 'a.tum')
    assert back[0] == pytest.approx(stamps, abs=1e-6)
    assert back[1] == pytest.approx(poses, abs=1e-6)
    write_tum(tmp_path / 'b.tum', [], np.zeros((0, 3)))
    assert read_tum(tmp_path / 'b.tum')[1].shape == (0, 3)


def test_the_team_gets_one_elastic_map(result: tuple[Path, dict], bags: tuple) -> None:
    folder, record = result
    pair = record['pairs'][0]
    assert pair['elastic'], pair['elastic_reason']
    assert pair['confirmed'] >= 0.75
    assert pair['views_matched'] >= 3
    assert pair['weakest_direction_m'] < 0.1
    assert pair['bend_m'] < 0.2          # the room is small
    first = record['robots']['robot1']
    assert 50 < first['view_bytes'] / first['views'] < 1000
    for robot in ('robot1', 'robot2'):
        stamps, _ = read_tum(folder / robot / 'joint.tum')
        assert np.array_equal(stamps, read_tum(folder / robot / 'trajectory.tum')[0])
        assert read_map(folder / robot / 'joint_map.yaml').occupied.any()


def test_a_joint_map_of_an_earlier_run_is_not_left_beside_a_rigid_result(tmp_path: Path) -> None:
    """The report would draw it as the bent map of what was replayed now."""
    runs: Any = {'robot1': None, 'robot2': None}
    for name in runs:
        (tmp_path / name).mkdir()
        for file in JOINT_FILES:
            (tmp_path / name / file).write_text('of an earlier run')
    save_joint(tmp_path, runs, SimpleNamespace(elastic=None))
    assert not [path for path in tmp_path.rglob('*') if path.is_file()]
