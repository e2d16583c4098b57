# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion merge` and `somfusion report`: stitched maps, refusals, and the pictures."""

import json
from pathlib import Path

import cv2
from helpers import cut_grid, fake_grid, fake_room, pose_error
import numpy as np
import pytest
from somfusion_ros.cli.main import main
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import MapError, read_map, write_map
from somfusion_ros.offline.merge import map_names, merge
from somfusion_ros.report.agreement import AGREE, compare, CONFLICT
from somfusion_ros.simulation.floor_plan import office

T_MAP_ROOM = Pose(-4.0, 7.0, 2.2)   # of the second map
PICTURES = {'maps', 'segments', 'clusters', 'orientation', 'radon', 'performance', 'fused',
            'trajectories', 'agreement', 'runner_up', 'verdict', 'team'}


@pytest.fixture(scope='module')
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Merge, by the command and with pictures, two maps that share most of a floor."""
    folder = tmp_path_factory.mktemp('merged')
    floor = fake_grid(office().segments)
    write_map(folder / 'in', cut_grid(floor, (-1, -1), (11.5, 11)), 'west')
    part = cut_grid(floor, (4.5, -1), (18, 11))
    moved = Pose.from_array(compose(T_MAP_ROOM, part.T_frame_grid))
    write_map(folder / 'in', Grid(part.evidence, part.resolution, moved), 'east')
    status = main(['merge', str(folder / 'in' / 'west.yaml'), str(folder / 'in' / 'east.yaml'),
                   '--output', str(folder / 'out')])
    assert status == 0
    return folder / 'out'


def test_stitches_two_maps(merged: Path) -> None:
    record = json.loads((merged / 'result.json').read_text())
    assert list(record['robots']) == ['west', 'east']
    assert record['pairs'][0]['accepted'], record['pairs'][0]['reason']
    found = record['pairs'][0]['transform']
    distance, angle = pose_error((found['x'], found['y'], found['theta']), inverse(T_MAP_ROOM))
    assert distance < 0.1
    assert angle < np.radians(1.0)
    whole, part = read_map(merged / 'map.yaml'), read_map(merged / 'west' / 'map.yaml')
    assert whole.known.sum() > 1.2 * part.known.sum()


def test_report_shows_every_figure(merged: Path) -> None:
    assert {path.stem for path in (merged / 'figures').glob('*.png')} == PICTURES
    for path in [merged / 'merge.png', merged / 'report.png', *(merged / 'figures').glob('*.png')]:
        image = cv2.imread(str(path))
        assert min(image.shape[:2]) > 400, path
        assert image.std() > 5.0, f'{path} is blank'


@pytest.mark.slow
def test_report_again(merged: Path, capsys: pytest.CaptureFixture) -> None:
    before = cv2.imread(str(merged / 'report.png'))
    (merged / 'report.png').unlink()
    assert main(['report', str(merged)]) == 0
    said = capsys.readouterr()
    assert str(merged / 'report.png') in said.out
    assert said.err == ''
    again = cv2.imread(str(merged / 'report.png'))
    assert again.shape == before.shape
    assert (again == before).mean() > 0.99   # but for the seconds in the verdict


def test_strangers_are_refused_and_it_ran(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    write_map(tmp_path, fake_grid(fake_room(14.0, 10.0)), 'room')
    circle = np.linspace(0.0, 2.0 * np.pi, 40)
    points = np.column_stack([5.0 * np.cos(circle), 3.0 * np.sin(circle)])
    write_map(tmp_path, fake_grid(np.column_stack([points[:-1], points[1:]])), 'dome')
    out = tmp_path / 'out'
    assert main(['merge', str(tmp_path / 'room.yaml'), str(tmp_path / 'dome.yaml'), '--output',
                 str(out), '--no-report']) == 0
    record = json.loads((out / 'result.json').read_text())
    assert not record['pairs'][0]['accepted']
    assert record['pairs'][0]['reason']
    assert list(record['transforms']) == ['room'] or list(record['transforms']) == ['dome']
    assert len(record['unconnected']) == 1
    (shown,), (other,) = record['groups']
    assert record['map_of'] == [shown]
    assert record['map_note'] == (
        f'no maps were joined: the joint map is that of {shown} alone, the first by name; '
        f'not in it: {other} in {other}/map.yaml')
    assert f'{out / "map.yaml"}: {record["map_note"]}\n' in capsys.readouterr().out


@pytest.mark.slow
def test_empty_map_is_refused_with_a_reason(tmp_path: Path) -> None:
    write_map(tmp_path, fake_grid(fake_room()), 'room')
    write_map(tmp_path, Grid(np.zeros((20, 30), np.float32), 0.05), 'nothing')
    record = merge([tmp_path / 'room.yaml', tmp_path / 'nothing.yaml'], tmp_path / 'out')
    assert record['pairs'][0]['transform'] is None
    assert not record['pairs'][0]['accepted']
    assert (tmp_path / 'out' / 'report.png').exists()


def test_names() -> None:
    paths = [Path(name) for name in ('/a/robot1/map.yaml', '/a/robot2/map.yaml', '/a/attic.yaml')]
    assert map_names(paths) == ['robot1', 'robot2', 'attic']
    assert map_names([Path('/a/one.yaml'), Path('/b/two.yaml')]) == ['one', 'two']
    assert map_names([Path('/a/map.yaml'), Path('/a/map.yaml')]) == ['a', 'a_2']


def test_a_map_that_the_result_would_overwrite_is_kept(tmp_path: Path) -> None:
    """The result of two maps is not one of them, and the pixels that it changes are not back."""
    for name in ('map', 'robot1/map', 'other'):
        write_map(tmp_path / Path(name).parent, fake_grid(fake_room()), Path(name).name)
    before = {path: path.read_bytes() for path in tmp_path.rglob('map.*')}
    for pair, kept in ((('map', 'other'), 'map.yaml'), (('robot1/map', 'map'), 'map.yaml')):
        with pytest.raises(MapError, match=f'{kept}: the result would overwrite it'):
            merge([tmp_path / f'{name}.yaml' for name in pair], tmp_path, pictures=False)
    assert {path: path.read_bytes() for path in tmp_path.rglob('map.*')} == before


def test_agreement_of_a_map_with_itself_and_moved() -> None:
    grid = fake_grid(fake_room())
    same = compare(grid, grid, Pose())
    assert (same == CONFLICT).sum() == 0
    assert (same == AGREE).sum() == grid.known.sum()
    moved = compare(grid, grid, Pose(0.5, 0.4, 0.1))
    assert (moved == CONFLICT).sum() > 0.5 * grid.occupied.sum()


def test_two_yamls_that_name_one_image_are_refused(tmp_path: Path) -> None:
    """A map fits itself with probability 1, which says nothing of two places."""
    path = write_map(tmp_path, fake_grid(fake_room()), 'floor1')
    (tmp_path / 'floor2.yaml').write_text(path.read_text())
    for pair in ([path, tmp_path / 'floor2.yaml'], [path, path], [path, tmp_path / 'floor1.pgm']):
        with pytest.raises(MapError, match='one map: both name floor1.pgm'):
            merge(pair, tmp_path / 'out')
