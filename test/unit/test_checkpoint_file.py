# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A SLAM that was saved and resumed goes on as if it had not been interrupted."""

from pathlib import Path

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose
from somfusion_ros.slam.checkpoint_file import load_checkpoint, save_checkpoint
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam

WALLS = fake_room()
ROUND = np.array([[1.5, 1.5], [4.5, 1.0], [6.8, 1.2], [6.8, 3.0], [4.5, 3.0], [2.0, 3.0],
                  [1.5, 5.0], [1.5, 2.0], [4.5, 1.2]])
STAMPS, TRUTH = fake_trajectory(ROUND)
ODOMETRY = fake_odometry(TRUTH)
HALF = len(STAMPS) // 2


def drive(slam: Slam, first: int, last: int) -> None:
    """Feed the scans of a part of the drive."""
    for i in range(first, last):
        slam.process(fake_scan(WALLS, TRUTH[i], STAMPS[i], beams=181),
                     Odometry(STAMPS[i], ODOMETRY[i], np.zeros(3)))


@pytest.fixture(scope='module')
def half() -> Slam:
    """Drive one half of the way."""
    slam = Slam()
    drive(slam, 0, HALF)
    return slam


def resumed(slam: Slam, path: Path) -> Slam:
    """Save a SLAM and start another one from the file."""
    save_checkpoint(path, slam.checkpoint())
    return Slam(slam.config, checkpoint=load_checkpoint(path))


def test_nothing_is_lost_by_a_restart(half: Slam, tmp_path: Path) -> None:
    again = resumed(half, tmp_path / 'state.npz')
    for before, after in zip((*half.views(), *half.trajectory()),
                             (*again.views(), *again.trajectory()), strict=True):
        assert np.array_equal(before, after)
    assert again.odometry_lag == half.odometry_lag
    assert np.allclose(again.pose_sigma, half.pose_sigma, rtol=1e-6)
    before, after = half.grid(), again.grid()
    assert after.shape == before.shape
    # Single precision moves a point by 1e-6 m, and few of them over the edge of a cell.
    assert np.mean(after.evidence != before.evidence) < 1e-3


@pytest.mark.slow
def test_a_resumed_drive_ends_where_an_uninterrupted_one_does(tmp_path: Path) -> None:
    whole, first = Slam(), Slam()
    drive(whole, 0, len(STAMPS))
    drive(first, 0, HALF)
    second = resumed(first, tmp_path / 'state.npz')
    drive(second, HALF, len(STAMPS))
    metres, radians = pose_error(second.trajectory()[1][-1], whole.trajectory()[1][-1])
    assert metres < 0.01
    assert radians < 0.005
    assert len(second.views()[0]) == len(whole.views()[0])


def test_a_robot_whose_odometry_began_anew_is_found_where_it_stood(half: Slam,
                                                                   tmp_path: Path) -> None:
    again = resumed(half, tmp_path / 'state.npz')
    T_map_start = compose(half.trajectory()[1][0], between(TRUTH[0], np.zeros(3)))
    for i in range(HALF, HALF + 30):
        odometry = between(ODOMETRY[HALF], ODOMETRY[i])
        step = again.process(fake_scan(WALLS, TRUTH[i], STAMPS[i] + 60.0, beams=181),
                             Odometry(STAMPS[i] + 60.0, odometry, np.zeros(3)))
    metres, radians = pose_error(step.pose, compose(T_map_start, TRUTH[i]))
    assert metres < 0.1
    assert radians < 0.03


def test_a_save_that_breaks_off_leaves_the_old_state(half: Slam, tmp_path: Path,
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'state.npz'
    save_checkpoint(path, half.checkpoint())
    before = path.read_bytes()

    def full(*given: object, **arrays: object) -> None:
        raise OSError('no space left on device')
    monkeypatch.setattr(np, 'savez', full)
    with pytest.raises(OSError, match='no space'):
        save_checkpoint(path, half.checkpoint())
    assert path.read_bytes() == before


@pytest.mark.parametrize('damage', [
    lambda b: b'', lambda b: b'this is no state', lambda b: b[:len(b) // 2],
    lambda b: b[:5000] + bytes(4000) + b[9000:]], ids=['empty', 'text', 'cut', 'zeros'])
def test_a_damaged_file_is_refused_by_name(damage: object, half: Slam, tmp_path: Path) -> None:
    path = tmp_path / 'state.npz'
    save_checkpoint(path, half.checkpoint())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match='state.npz: not a usable checkpoint'):
        load_checkpoint(path)


@pytest.mark.parametrize(('name', 'change'), [
    ('version', lambda v: v + 1), ('poses', lambda v: v[:-1]), ('poses', lambda v: v * np.nan),
    ('scan_views', lambda v: v + 1000), ('scan_clouds', lambda v: v - 1),
    ('tracker_P', lambda v: v[:2]), ('tracker_odometry', lambda v: v[:0]),
    ('ends', lambda v: v[:-3]), ('constraints', lambda v: v[:3]), ('track', lambda v: v[:0]),
    ('beams_lengths', lambda v: v + 1)])
def test_a_file_whose_parts_do_not_fit_is_refused(name: str, change: object, half: Slam,
                                                  tmp_path: Path) -> None:
    path = tmp_path / 'state.npz'
    save_checkpoint(path, half.checkpoint())
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    arrays[name] = change(arrays[name])
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match='not a usable checkpoint'):
        load_checkpoint(path)


def test_no_file_is_no_damage(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_checkpoint(tmp_path / 'nothing.npz')
