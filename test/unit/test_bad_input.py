# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags and folders that cannot be used: one line that names them, exit status 2, no traceback."""

from dataclasses import replace
import json
from pathlib import Path
import shutil

from helpers import fake_room, fake_scan, write_fake_bag
import numpy as np
import pytest
from somfusion_ros.cli.main import main
from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags.log import BagError, BagOptions, open_log
from somfusion_ros.io.bags.writer import BagWriter
from somfusion_ros.offline.robot_run import run_robot
from somfusion_ros.slam.scan import Scan

pytestmark = pytest.mark.slow


def bad_bag(path: Path) -> str:
    """Read a bag to its end; give the one line that it must fail with."""
    with pytest.raises(BagError) as error:
        list(open_log(path))
    text = str(error.value)
    assert '\n' not in text
    assert str(path) in text
    return text


@pytest.fixture(scope='module', params=['mcap', 'sqlite3'])
def good(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a good bag, for the tests to spoil copies of."""
    folder = tmp_path_factory.mktemp('good') / 'bag'
    write_fake_bag(folder, storage=request.param, every=2)
    return folder


def storage_of(folder: Path) -> Path:
    """Find the file with the messages."""
    return next(f for f in folder.iterdir() if f.suffix in ('.mcap', '.db3'))


def test_missing(tmp_path: Path) -> None:
    assert bad_bag(tmp_path / 'none').endswith('no such file or folder')


def test_foreign_folder(tmp_path: Path) -> None:
    (tmp_path / 'picture.jpg').write_bytes(b'x')
    assert 'not a bag' in bad_bag(tmp_path)


def test_a_folder_of_bags_names_one_of_them(good: Path, tmp_path: Path) -> None:
    shutil.copytree(good, tmp_path / 'robot1')
    assert bad_bag(tmp_path).endswith(f'name those that it holds, such as {tmp_path / "robot1"}')


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a.bag', 'a.txt'])
@pytest.mark.parametrize('content', [b'', b'garbage', bytes(range(256)) * 40])
def test_foreign_file(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    bad_bag(path)


@pytest.mark.parametrize('text', ['', 'no: bag', '[1, 2', 'rosbag2_bagfile_information: 3'])
def test_foreign_metadata(good: Path, tmp_path: Path, text: str) -> None:
    folder = shutil.copytree(good, tmp_path / 'bag')
    (folder / 'metadata.yaml').write_text(text)
    log = open_log(folder)
    assert any(isinstance(record, Scan) for record in log)
    assert 'metadata.yaml cannot be used' in log.notes[0]


def cut(good: Path, folder: Path, share: float) -> Path:
    """Copy a bag whose file ends after a share of its bytes."""
    copy = shutil.copytree(good, folder)
    data = storage_of(copy).read_bytes()
    storage_of(copy).write_bytes(data[:int(share * len(data))])
    return copy


@pytest.mark.parametrize('share', [0.0, 0.001, 0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize('metadata', [True, False])
def test_cut_off_is_read_as_far_as_it_goes_or_names_the_remedy(
        good: Path, tmp_path: Path, share: float, metadata: bool) -> None:
    folder = cut(good, tmp_path / 'bag', share)
    if not metadata:
        (folder / 'metadata.yaml').unlink()
    if any(folder.glob('*.db3')) or share < 0.01:
        said = bad_bag(folder)
        assert 'may help' in said or 'empty file' in said
        return
    log = open_log(folder)
    read, whole = (sum(isinstance(record, Scan) for record in one) for one in (
        log, open_log(good)))
    assert read >= (share - 0.1) * whole
    assert any('mcap recover may bring more' in note for note in log.notes)


def test_damaged_in_the_middle_is_an_error_or_harmless(good: Path, tmp_path: Path) -> None:
    """Whatever bytes are spoilt, no other error than BagError comes out."""
    rng = np.random.default_rng(3)
    data = storage_of(good).read_bytes()
    for trial in range(25):
        spoilt = bytearray(data)
        at = int(rng.integers(len(data) - 64))
        spoilt[at:at + 64] = rng.bytes(64)
        path = tmp_path / f'{trial}{storage_of(good).suffix}'
        path.write_bytes(spoilt)
        try:
            list(open_log(path))
        except BagError as error:
            assert str(path) in str(error)


def test_missing_storage_file(good: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(good, tmp_path / 'bag')
    storage_of(folder).unlink()
    bad_bag(folder)


def test_without_scans(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.odometry(1.0, (0.0, 0.0, 0.0))
    assert bad_bag(tmp_path / 'bag').endswith('no laser scans (the bag holds /odom)')


def test_without_odometry(tmp_path: Path) -> None:
    """It is mapped from the scans alone, which is said; who asks for odometry is told."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.scan(fake_scan(fake_room(), (1.0, 1.0, 0.0), 1.0))
    log = open_log(tmp_path / 'bag')
    assert log.odometry_source == 'none'
    assert 'no odometry' in log.notes[0]
    assert not any('no odometry' in note for note in open_log(
        tmp_path / 'bag', BagOptions(odometry_source='none')).notes)
    for source in ('odom', 'tf'):
        with pytest.raises(BagError, match='no odom'):
            open_log(tmp_path / 'bag', BagOptions(odometry_source=source))


def test_odometry_of_another_day(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        for number in range(5):
            bag.odometry(1.0 + number, (0.0, 0.0, 0.0))
            bag.scan(fake_scan(fake_room(), (1.0, 1.0, 0.0), 90000.0 + number))
    with pytest.raises(BagError, match='no scan has odometry at its time'):
        run_robot(open_log(tmp_path / 'bag'))


USELESS = {
    'inf': {'ranges': np.full(181, np.inf)}, 'nan': {'ranges': np.full(181, np.nan)},
    '0': {'ranges': np.zeros(181)}, 'millimetres': {'ranges': np.full(181, 2500.0)},
    'range_max 0': {'range_max': 0.0}, 'angle_increment 0': {'angle_increment': 0.0},
    'ranges': {'ranges': np.zeros(0)}}


@pytest.mark.parametrize('cause', USELESS)
def test_scans_of_which_none_can_be_used_end_a_replay_with_the_cause(
        cause: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """An empty map with status 0 tells nobody that a laser is set up wrongly."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.mount(1.0, Pose())
        for number in range(30):
            bag.odometry(1.0 + 0.1 * number, (0.02 * number, 0.0, 0.0))
            scan = fake_scan(fake_room(), (1.0, 1.0, 0.0), 1.0 + 0.1 * number, beams=181)
            bag.scan(replace(scan, **USELESS[cause]))
    said = command(capsys, 'replay', tmp_path / 'bag', '--output', tmp_path / 'out')
    assert str(tmp_path / 'bag') in said
    assert cause.split()[0] in said.lower()
    assert not (tmp_path / 'out' / 'map.yaml').exists()


def spoil(scan: Scan, number: int) -> Scan:
    """Make one of the scans that drivers of real robots send when something is wrong."""
    ranges = scan.ranges.copy()
    kind = number % 6
    if kind == 1:
        ranges[:] = np.nan
    elif kind == 2:
        ranges = ranges[:0]
    elif kind == 3:
        ranges = ranges[::2]
    elif kind == 4:
        ranges[::3] = [np.nan, np.inf, -np.inf, 0.0, 1e30][number % 5]
    increment = scan.angle_increment * (2.0 if kind == 3 else 1.0)
    stamp = scan.stamp - (0.35 if kind == 5 else 0.0)
    return Scan(stamp, ranges, scan.angle_min, increment, scan.range_min, scan.range_max)


def test_bad_scans_among_good_ones_leave_a_map(tmp_path: Path) -> None:
    """NaN, empty, halved, mixed and repeated scans: the robot is followed all the same."""
    walls, stamps = fake_room(), np.arange(0.0, 6.0, 0.1)
    poses = np.column_stack([1.0 + 0.4 * stamps, np.full(len(stamps), 2.0), 0.1 * stamps])
    with BagWriter(tmp_path / 'bag') as bag:
        for number, (stamp, pose) in enumerate(zip(stamps, poses)):
            bag.odometry(10.0 + stamp, pose - (1.0, 2.0, 0.0))
            bag.scan(spoil(fake_scan(walls, pose, 10.0 + stamp), number))
    run = run_robot(open_log(tmp_path / 'bag'))
    assert np.hypot(*(run.poses[-1, :2] - (poses[-1, :2] - (1.0, 2.0)))) < 0.15
    assert run.grid.occupied.sum() > 100
    assert any(name.startswith('scan_') for name in run.counters), 'what was bad is counted'


def command(capsys: pytest.CaptureFixture, *arguments: object) -> str:
    """Run a command that must fail; give its one line on stderr."""
    assert main([str(a) for a in arguments]) == 2
    said = capsys.readouterr()
    assert said.err.count('\n') == 1
    assert 'Traceback' not in said.err
    return said.err


def test_commands_name_the_file(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / 'out'
    for arguments in (('replay', tmp_path / 'a', '--output', out),
                      ('merge', tmp_path / 'a', tmp_path / 'b', '--output', out),
                      ('report', tmp_path / 'a')):
        assert str(tmp_path / 'a') in command(capsys, *arguments)
    assert not out.exists()


def test_a_bag_that_is_none_beside_a_good_one(good: Path, tmp_path: Path,
                                              capsys: pytest.CaptureFixture) -> None:
    folder = cut(good, tmp_path / 'bag', 0.001)
    assert str(folder) in command(capsys, 'replay', good, folder, '--output', tmp_path / 'out')


def test_a_folder_for_a_file_is_named_without_the_number_of_the_error(
        good: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    said = command(capsys, 'replay', good, '--output', tmp_path / 'out', '--state', tmp_path)
    assert said == f'somfusion replay: {tmp_path}: Is a directory\n'


def test_output_that_is_a_file(good: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / 'out').write_text('')
    for arguments in (('replay', good), ('simulate',)):
        assert str(tmp_path / 'out') in command(capsys, *arguments, '--output', tmp_path / 'out')


@pytest.mark.parametrize('arguments', [
    [], ['dance'], ['replay'], ['replay', 'a'], ['replay', 'a', '--output', 'b', '--jobs', '0'],
    ['replay', 'a', '--output', 'b', '--laser-pose', '1,2'],
    ['replay', 'a', '--output', 'b', '--wheel-radius', '-1'],
    ['simulate', '--output', 'b', '--plan', 'castle'],
    ['simulate', '--output', 'b', '--robots', 'two']])
def test_bad_usage(arguments: list[str], capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    assert 'usage: somfusion' in capsys.readouterr().err


def test_merge_of_one_map(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert 'at least two' in command(capsys, 'merge', 'a.yaml', '--output', tmp_path / 'out')


def test_report_of_a_folder_that_is_no_result(tmp_path: Path,
                                              capsys: pytest.CaptureFixture) -> None:
    whole = {'robots': {'a': {}, 'b': {}}, 'pairs': [{'target': 'a', 'source': 'b'}],
             'transforms': {'a': {'x': 0.0, 'y': 0.0, 'theta': 0.0}}}
    for changes in ({'pairs': 3}, {'robots': ['a', 'b']}, {'robots': {'a': {}}},
                    {'transforms': 3}, {'transforms': {'a': {'x': 1.0}}},
                    {'transforms': {'a': None}}, {'transforms': {'c': {}}}):
        (tmp_path / 'result.json').write_text(json.dumps(whole | changes))
        assert 'not a result' in command(capsys, 'report', tmp_path)
    (tmp_path / 'result.json').write_text(json.dumps(whole))
    assert 'evidence.npz' in command(capsys, 'report', tmp_path)   # read, but without its maps
