# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Saved maps survive the way to disk and back, and follow map_server's rules."""

from pathlib import Path

import cv2
from helpers import cut_grid, DATA, fake_grid, fake_room
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import MapError, read_map, write_map

SHADES = np.array([[0, 88, 90, 127, 204, 205, 206, 254, 255]], np.uint8)


def write_yaml(folder: Path, pgm: bytes, **fields: object) -> Path:
    """Write a map of one image; fields replace or add to the usual ones."""
    (folder / 'map.pgm').write_bytes(pgm)
    lines = {'image': 'map.pgm', 'resolution': 0.05, 'origin': [0.0, 0.0, 0.0], 'negate': 0,
             'occupied_thresh': 0.65, 'free_thresh': 0.196} | fields
    path = folder / 'map.yaml'
    path.write_text('\n'.join(f'{key}: {value}' for key, value in lines.items()
                              if value is not None))
    return path


def p5(shades: np.ndarray) -> bytes:
    """Make a binary PGM."""
    return b'P5\n%d %d\n255\n' % shades.shape[::-1] + shades.tobytes()


def cells(folder: Path, image: bytes, **fields: object) -> list[int]:
    """Read back the occupancy of a one-row map."""
    return read_map(write_yaml(folder, image, **fields)).to_occupancy()[0].tolist()


@pytest.mark.parametrize('yaw', [0.0, 0.7, -2.5])
def test_roundtrip(tmp_path: Path, yaw: float) -> None:
    grid = cut_grid(fake_grid(fake_room(), 0.07, Pose(-3.2, 1.5, yaw)), (-3, -3), (3, 6))
    back = read_map(write_map(tmp_path / 'new' / 'folder', grid))
    assert back.shape == grid.shape
    assert back.resolution == grid.resolution
    assert back.T_frame_grid == pytest.approx(grid.T_frame_grid)
    assert np.array_equal(back.evidence, grid.evidence)


@pytest.mark.parametrize('name', ['floor: 2', '#1', '- a', "the robot's", 'Küche', 'a' * 120])
def test_a_map_of_any_name_is_read_again(name: str, tmp_path: Path) -> None:
    path = write_map(tmp_path, Grid(np.ones((2, 3), np.float32), 0.05), name)
    assert path.name == f'{name}.yaml'
    assert read_map(path).shape == (2, 3)


def test_unsure_cells_are_written_as_unknown(tmp_path: Path) -> None:
    grid = Grid(np.array([[-1.0, -0.31, -0.29, 0.0, 0.59, 0.62, 1.0]], np.float32), 0.05)
    write_map(tmp_path, grid)
    assert (tmp_path / 'map.pgm').read_bytes()[-7:] == bytes([0, 0, 205, 205, 205, 254, 254])
    assert 'free_thresh: 0.196' in (tmp_path / 'map.yaml').read_text()
    assert read_map(tmp_path / 'map.yaml').to_occupancy().tolist() == [[100, 100, -1, -1, -1, 0,
                                                                        0]]


def test_rows_run_from_the_top_of_the_image(tmp_path: Path) -> None:
    grid = read_map(write_yaml(tmp_path, p5(np.array([[0], [254]], np.uint8)), resolution=1.0))
    assert grid.points(grid.occupied).tolist() == [[0.5, 1.5]]


def test_trinary(tmp_path: Path) -> None:
    expected = [100, 100, -1, -1, -1, -1, 0, 0, 0]
    assert cells(tmp_path, p5(SHADES)) == expected
    assert cells(tmp_path, p5(SHADES), mode='trinary') == expected


def test_unknown_stays_unknown_beside_the_threshold_of_nav2(tmp_path: Path) -> None:
    assert cells(tmp_path, p5(SHADES), free_thresh=0.25) == [100, 100, -1, -1, 0, -1, 0, 0, 0]


def test_negate(tmp_path: Path) -> None:
    assert cells(tmp_path, p5(255 - SHADES), negate=1) == [100, 100, -1, -1, -1, -1, 0, 0, 0]


def test_scale(tmp_path: Path) -> None:
    found = cells(tmp_path, p5(SHADES), mode='scale', occupied_thresh=0.9, free_thresh=0.1)
    assert found[0] == 100
    assert found[-1] == found[-2] == 0
    p = 1.0 - SHADES[0] / 255.0
    between = [1, 2, 4, 5, 6]   # 127 is 50 percent, which is as good as unknown
    assert [found[k] for k in between] == pytest.approx(100 * (p[between] - 0.1) / 0.8, abs=0.6)


def test_raw(tmp_path: Path) -> None:
    shades = np.array([[0, 20, 100, 101, 255]], np.uint8)
    assert cells(tmp_path, p5(shades), mode='raw') == [0, 20, 100, -1, -1]


def test_plain_and_deep_pgm_are_the_same(tmp_path: Path) -> None:
    plain = b'P2\n# a comment\n9 1\n255\n' + b' '.join(b'%d' % v for v in SHADES[0])
    deep = b'P5 9 1 65535\n' + (SHADES.astype('>u2') * 257).tobytes()
    commented = b'P5\n#one\n#two\n9 # three\n1\n255\n' + SHADES.tobytes()
    for image in (plain, deep, commented):
        assert cells(tmp_path, image) == cells(tmp_path, p5(SHADES))


@pytest.mark.parametrize('fields, message', [
    ({'image': None}, "no 'image'"),
    ({'resolution': None}, "no 'resolution'"),
    ({'origin': None}, "no 'origin'"),
    ({'image': 'missing.pgm'}, 'missing.pgm: No such file'),
    ({'resolution': 0.0}, 'resolution must be positive'),
    ({'resolution': '.nan'}, 'resolution must be positive'),
    ({'resolution': 'fine'}, 'could not convert'),
    ({'origin': '[0.0, 0.0]'}, 'origin must be three finite numbers'),
    ({'origin': '[.nan, 0.0, 0.0]'}, 'origin must be three finite numbers'),
    ({'origin': '[0.0, 0.0, 90.0]'}, 'in degrees'),
    ({'origin': 7}, 'map.yaml'),
    ({'mode': 'colour'}, "mode 'colour' is none of"),
    ({'free_thresh': 0.9}, 'thresholds must rise'),
    ({'negate': 'perhaps'}, 'map.yaml'),
])
def test_bad_yaml(tmp_path: Path, fields: dict, message: str) -> None:
    with pytest.raises(MapError, match=message) as error:
        read_map(write_yaml(tmp_path, p5(SHADES), **fields))
    assert '\n' not in str(error.value)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize('image, message', [
    (b'', 'not an image'),
    (b'\x00\x01garbage', 'not an image'),
    (b'P5', 'header'),
    (b'P5\n9 1\n', 'header'),
    (b'P5\n9 x\n255\n', 'header'),
    (b'P5\n0 1\n255\n', 'makes no sense'),
    (b'P5\n99999999 99999999\n255\n\x00', 'makes no sense'),
    (b'P5\n9 2\n255\n' + SHADES.tobytes(), 'truncated: 9 of 9 x 2'),
    (b'P2\n3 1\n255\n1 2', 'truncated: 2 of 3 x 1'),
    (b'P2\n3 1\n255\n1 2 wall', 'not a number'),
    (b'P2\n3 1\n100\n1 2 101', 'outside 0..100'),
])
def test_bad_image(tmp_path: Path, image: bytes, message: str) -> None:
    with pytest.raises(MapError, match=message) as error:
        read_map(write_yaml(tmp_path, image))
    assert str(tmp_path / 'map.pgm') in str(error.value)


@pytest.mark.parametrize('text', ['', 'just a sentence', '- a\n- list', '{unclosed: [', '\x00'])
def test_foreign_yaml(tmp_path: Path, text: str) -> None:
    (tmp_path / 'map.yaml').write_text(text)
    with pytest.raises(MapError, match='map.yaml: not'):
        read_map(tmp_path / 'map.yaml')


def test_missing_yaml(tmp_path: Path) -> None:
    with pytest.raises(MapError, match='none.yaml: not readable .No such file'):
        read_map(tmp_path / 'none.yaml')


@pytest.mark.parametrize('mode', ['trinary', 'scale'])
def test_what_is_not_opaque_is_unknown_whatever_its_shade(mode: str, tmp_path: Path) -> None:
    """map_saver writes unknown cells of scale mode as transparent ones."""
    shades = np.array([[0, 254, 0], [254, 0, 254]], np.uint8)
    alpha = np.array([[255, 255, 0], [0, 254, 255]], np.uint8)
    cv2.imwrite(str(tmp_path / 'map.png'), np.dstack([shades, shades, shades, alpha]))
    (tmp_path / 'map.yaml').write_text(
        f'image: map.png\nmode: {mode}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n'
        'occupied_thresh: 0.65\nfree_thresh: 0.25\n')
    assert read_map(tmp_path / 'map.yaml').to_occupancy()[::-1].tolist() == [
        [100, 0, -1], [-1, -1, 0]]


@pytest.mark.parametrize('depth', [np.uint8, np.uint16])
@pytest.mark.parametrize('channels', [1, 3, 4])
def test_images_of_every_kind_are_read_alike(depth: type, channels: int, tmp_path: Path) -> None:
    shades = np.array([[0, 254], [205, 0]], depth) * (257 if depth is np.uint16 else 1)
    image = np.dstack([shades.astype(depth)] * channels).squeeze()
    if channels == 4:
        image[..., 3] = np.iinfo(depth).max
    cv2.imwrite(str(tmp_path / 'map.png'), image.astype(depth))
    (tmp_path / 'map.yaml').write_text('image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\n')
    assert read_map(tmp_path / 'map.yaml').to_occupancy()[::-1].tolist() == [[100, 0], [-1, 100]]


def test_the_image_given_for_its_yaml(tmp_path: Path) -> None:
    path = write_map(tmp_path, fake_grid(fake_room()), 'floor')
    for image, yaml_name in (('floor.pgm', 'floor.yaml'), ('floor.pgm', 'other_name.yaml')):
        path = path.rename(tmp_path / yaml_name)
        assert read_map(tmp_path / image).occupied.sum() == read_map(path).occupied.sum()
    path.unlink()
    with pytest.raises(MapError, match='image without a map_server YAML'):
        read_map(tmp_path / 'floor.pgm')


@pytest.mark.parametrize('folder', ['/home/robot/maps/', 'C:\\maps\\', 'maps/'])
def test_a_path_of_another_computer_falls_back_to_the_file_beside(folder: str,
                                                                  tmp_path: Path) -> None:
    path = write_map(tmp_path, fake_grid(fake_room()))
    path.write_text(path.read_text().replace('image: ', f'image: {folder}'))
    assert read_map(path).occupied.sum() > 100


def test_the_shared_images_with_alpha() -> None:
    """Both thresholds of map_saver give the same unknown cells, far more than none."""
    folder = DATA.parent / 'cases' / 'alpha'
    if not folder.exists():
        pytest.skip('the shared samples are not on this machine (set SOMFUSION_DATA)')
    for name in 'ab':
        found = [read_map(folder / f'{name}_{threshold}.yaml') for threshold in ('0.25', '0.196')]
        unknown = [(~grid.known).mean() for grid in found]
        assert unknown[0] == unknown[1] > 0.1
        assert all(grid.free.any() and grid.occupied.any() for grid in found)
