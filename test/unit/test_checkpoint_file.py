# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A SLAM that was saved and resumed goes on as if it had not been interrupted."""

from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from threading import Event
import time

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.grid import Grid
from somfusion_ros.offline.beginning import from_state
from somfusion_ros.slam import restart
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.checkpoint_file import (CheckpointFile, load_checkpoint,
                                                save_checkpoint)
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.checkpoint_reader import assemble
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.grid_views import grid_checkpoint
from somfusion_ros.slam.journal import JournalInUse, packed, records
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import cloud
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.tracking import Tracker

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
    again = resumed(half, tmp_path / 'state.map')
    for before, after in zip((*half.views(), *half.trajectory()),
                             (*again.views(), *again.trajectory()), strict=True):
        assert np.array_equal(before, after)
    assert again.odometry_lag == half.odometry_lag
    assert np.allclose(again.pose_sigma, half.pose_sigma, rtol=1e-3)   # linearised anew
    kept, written = again.checkpoint(), half.checkpoint()
    assert (kept.around, kept.fresh) == (written.around, written.fresh)
    assert written.around and written.fresh
    for old, new in zip(written.scans, kept.scans, strict=True):
        assert np.array_equal(new.outline.ends, old.outline.ends)
    before, after = half.grid(), again.grid()
    assert after.shape == before.shape
    # Single precision moves a point by 1e-6 m, and few of them over the edge of a cell.
    assert np.mean(after.evidence != before.evidence) < 1e-3


@pytest.mark.slow
def test_a_resumed_drive_ends_where_an_uninterrupted_one_does(tmp_path: Path) -> None:
    whole, first = Slam(), Slam()
    drive(whole, 0, len(STAMPS))
    drive(first, 0, HALF)
    second = resumed(first, tmp_path / 'state.map')
    drive(second, HALF, len(STAMPS))
    metres, radians = pose_error(second.trajectory()[1][-1], whole.trajectory()[1][-1])
    assert metres < 0.01
    assert radians < 0.005
    # Linearised anew, what decides about a view differs a little.
    assert len(second.views()[0]) == pytest.approx(len(whole.views()[0]), rel=0.05)


def test_a_robot_that_drove_on_while_its_program_was_restarted_goes_on(half: Slam,
                                                                       tmp_path: Path) -> None:
    """Its odometry tells where it is: as after a gap between scans, it is never lost."""
    again = resumed(half, tmp_path / 'state.map')
    first = next(i for i in range(HALF, len(STAMPS)) if np.hypot(
        *between(ODOMETRY[HALF - 1], ODOMETRY[i])[:2]) > 1.0)
    T_map_start = compose(half.trajectory()[1][0], between(TRUTH[0], np.zeros(3)))
    for i in range(first, first + 20):
        step = again.process(fake_scan(WALLS, TRUTH[i], STAMPS[i], beams=181),
                             Odometry(STAMPS[i], ODOMETRY[i], np.zeros(3)))
        assert not again.lost
        assert step.reason != 'lost'
    assert pose_error(step.pose, compose(T_map_start, TRUTH[i]))[0] < 0.1


@pytest.mark.parametrize(('before', 'now', 'pause', 'went_on'), [
    ((3.0, 1.0, 0.2), (4.0, 1.5, 0.3), 5.0, True),
    ((3.0, 1.0, 0.2), (4.0, 1.5, 0.3), 25.0, False),      # it may be anywhere
    ((3.0, 1.0, 0.2), (3.1, 1.0, 0.2), 5.0, False),       # it may have been carried
    ((1.0, 1.0, 0.2), (0.0, 0.1, 0.0), 5.0, False),       # the odometry began anew
    ((3.0, 1.0, 0.2), (7.0, 5.0, 0.3), 15.0, False),      # odometry says too little
    ((3.0, 1.0, 0.2), (5.0, 1.0, 0.3), 0.5, False)])      # it is another odometry
def test_odometry_goes_on_where_it_may_well(before: tuple[float, ...], now: tuple[float, ...],
                                            pause: float, went_on: bool) -> None:
    tracker = Tracker(SlamConfig())
    tracker.odometry = Odometry(10.0, np.array(before), np.zeros(3))
    later = Odometry(10.0 + pause, np.array(now), np.zeros(3))
    assert restart.went_on(tracker, later) == went_on


def test_a_robot_whose_odometry_began_anew_is_found_where_it_stood(half: Slam,
                                                                   tmp_path: Path) -> None:
    again = resumed(half, tmp_path / 'state.map')
    T_map_start = compose(half.trajectory()[1][0], between(TRUTH[0], np.zeros(3)))
    for i in range(HALF, HALF + 30):
        odometry = between(ODOMETRY[HALF], ODOMETRY[i])
        step = again.process(fake_scan(WALLS, TRUTH[i], STAMPS[i] + 60.0, beams=181),
                             Odometry(STAMPS[i] + 60.0, odometry, np.zeros(3)))
    metres, radians = pose_error(step.pose, compose(T_map_start, TRUTH[i]))
    assert metres < 0.1
    assert radians < 0.03


def test_a_full_disk_leaves_the_old_state(half: Slam, tmp_path: Path,
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'state.map'
    save_checkpoint(path, half.checkpoint())
    before = path.read_bytes()

    def full(number: int) -> None:
        raise OSError('no space left on device')
    monkeypatch.setattr('os.fsync', full)
    with pytest.raises(OSError, match='no space'):
        save_checkpoint(path, half.checkpoint())
    assert path.read_bytes() == before


def test_a_disk_that_is_full_for_a_while_costs_what_came_meanwhile(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, slam = tmp_path / 'state.map', Slam()
    drive(slam, 0, HALF // 2)
    file = CheckpointFile(path)
    file.save(slam.checkpoint())
    drive(slam, HALF // 2, HALF)

    def full(number: int) -> None:
        raise OSError('no space left on device')
    with monkeypatch.context() as patch, pytest.raises(OSError, match='no space'):
        patch.setattr('os.fsync', full)
        file.save(slam.checkpoint())
    file.save(slam.checkpoint())
    again = load_checkpoint(path)
    assert np.allclose(again.poses, slam.views()[1])
    assert len(again.trail) == HALF


def test_a_checkpoint_costs_what_has_changed(tmp_path: Path) -> None:
    path, slam = tmp_path / 'state.map', Slam()
    drive(slam, 0, HALF)
    file = CheckpointFile(path)
    whole = file.save(slam.checkpoint())
    drive(slam, HALF, HALF + 10)
    changed = file.save(slam.checkpoint())
    assert 0 < changed < 0.2 * whole
    assert path.stat().st_size == whole + changed
    again = load_checkpoint(path)
    assert np.array_equal(again.poses, slam.views()[1])
    assert len(again.scans) == len(slam.checkpoint().scans)


def test_what_is_written_again_and_again_does_not_grow(half: Slam, tmp_path: Path,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('somfusion_ros.slam.checkpoint_file.LEAST', 0)
    file = CheckpointFile(tmp_path / 'state.map')
    whole = file.save(half.checkpoint())
    for _ in range(200):
        file.save(half.checkpoint())
        assert (tmp_path / 'state.map').stat().st_size < 2.2 * whole


def test_two_processes_do_not_keep_one_file(half: Slam, tmp_path: Path) -> None:
    first = CheckpointFile(tmp_path / 'state.map')
    with pytest.raises(JournalInUse, match='state.map is in use by another'):
        CheckpointFile(tmp_path / 'state.map')
    first.close()
    CheckpointFile(tmp_path / 'state.map').close()


def test_a_directory_is_refused_and_left_alone(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match='is a directory'):
        CheckpointKeeper(str(tmp_path), 10.0, lambda *given: None, print)
    assert tmp_path.is_dir()


def test_a_reset_is_not_undone_by_a_late_write(half: Slam, tmp_path: Path) -> None:
    path = tmp_path / 'state.map'
    keeper = CheckpointKeeper(str(path), 10.0, lambda *given: None, lambda text: None)
    keeper.keep(half, object(), 0.0)
    assert path.exists()
    keeper.forget(half)
    keeper.keep(half, object(), 100.0)
    assert not path.exists()


def test_a_reset_waits_for_a_write_that_has_begun(half: Slam, tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    path, begun, ends = tmp_path / 'state.map', Event(), Event()
    keeper = CheckpointKeeper(str(path), 10.0, lambda *given: None, lambda text: None)
    save = CheckpointFile.save

    def slow(file: CheckpointFile, checkpoint: Checkpoint) -> int:
        begun.set()
        ends.wait(20.0)
        return save(file, checkpoint)
    monkeypatch.setattr(CheckpointFile, 'save', slow)
    with ThreadPoolExecutor(2) as threads:
        written = threads.submit(keeper.keep, half, object(), 0.0)
        assert begun.wait(20.0)
        forgotten = threads.submit(keeper.forget, half)
        assert wait([forgotten], 0.1).not_done
        ends.set()
        written.result(20.0)
        forgotten.result(20.0)
    assert not path.exists()


def test_a_robot_goes_on_in_the_map_of_a_day_within_two_seconds(tmp_path: Path) -> None:
    """With 800 views and 3000 scans, more than a day in an office leaves; in seconds of CPU."""
    path, slam, number = tmp_path / 'state.map', Slam(), 800
    drive(slam, 0, 10)
    day, seen = slam.checkpoint(), fake_scan(WALLS, TRUTH[0], 0.0, beams=181)
    poses = np.column_stack([np.arange(number) % 40 * 0.2, np.arange(number) // 40 * 0.2,
                             np.zeros(number)])
    ties = [Constraint(k - back, k, between(poses[k - back], poses[k]), 1e-4 * np.eye(3))
            for k in range(1, number) for back in (1, 40) if back <= k]
    clouds = [cloud(seen, 30.0) for _ in range(number)]
    scans = [MapScan(k % number, np.zeros(3), cloud(seen, 30.0).outline) for k in range(3000)]
    save_checkpoint(path, replace(day, poses=poses, stamps=np.arange(number) * 1.0, clouds=clouds,
                                  constraints=ties, scans=scans))
    began = time.process_time()
    again = Slam(background=True, checkpoint=load_checkpoint(path))
    step = again.process(replace(seen, stamp=2e4), Odometry(2e4, ODOMETRY[0], np.zeros(3)))
    assert time.process_time() - began < 2.0
    assert step.reason == 'lost', 'until a second thread has found that it is still there'
    assert len(again.views()[0]) == number


@pytest.mark.parametrize('damage', [
    lambda b: b'', lambda b: b'this is no state', lambda b: bytes(len(b))],
    ids=['empty', 'text', 'zeros'])
def test_a_file_without_a_checkpoint_is_refused_by_name(damage: object, tmp_path: Path,
                                                        half: Slam) -> None:
    path = tmp_path / 'state.map'
    save_checkpoint(path, half.checkpoint())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match='state.map: not a usable checkpoint'):
        load_checkpoint(path)


@pytest.fixture(scope='module')
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, Checkpoint]:
    """Write three checkpoints of a drive; return the file, and the last but one of them."""
    path, slam = tmp_path_factory.mktemp('written') / 'state.map', Slam()
    file, kept = CheckpointFile(path), []
    for last in (HALF - 40, HALF - 20, HALF):
        drive(slam, len(slam.trajectory()[0]), last)
        kept.append(slam.checkpoint())
        file.save(kept[-1])
    return path.read_bytes(), kept[1]


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 1.0, exclude_max=True), st.integers(0, 7))
def test_one_flipped_bit_costs_at_most_the_last_interval(
        written: tuple[bytes, Checkpoint], at: float, bit: int) -> None:
    data, before = bytearray(written[0]), written[1]
    data[int(at * len(data))] ^= 1 << bit
    found, flaws = assemble(bytes(data))
    assert flaws.damaged <= 2 and not flaws.refused
    n = len(before.poses)
    assert len(found.poses) >= n
    assert np.allclose(found.poses[:n], before.poses, atol=0.05)
    graph = found.graph()
    assert graph.ekf.n == len(found.poses)
    assert sum(len(cloud) == 0 for cloud in found.clouds) <= 1
    assert len(found.scans) >= len(before.scans) - 1


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 1.0))
def test_a_torn_write_costs_at_most_the_last_interval(
        written: tuple[bytes, Checkpoint], share: float) -> None:
    data, before = written
    found, _ = assemble(data[:len(data) - int((1.0 - share) * 2000)])
    assert len(found.poses) >= len(before.poses)
    assert found.graph().ekf.n == len(found.poses)


ABSURD = {
    'no number': lambda array: np.full(array.shape, np.nan),
    'infinite': lambda array: np.full(array.shape, np.inf),
    'huge': lambda array: np.full(array.shape, 1e30),
    'huge and whole': lambda array: np.full(array.shape, 2 ** 60),
    'complex': lambda array: array.astype(complex),
    'text': lambda array: np.full(array.shape, b'word'),
    'too short': lambda array: array.reshape(-1)[:len(array.reshape(-1)) // 2]}


@pytest.mark.parametrize('wrong', ABSURD)
@pytest.mark.parametrize('kind, name, told', [
    ('view', 'ends', 'a view: '), ('view', 'reach', 'a view: '), ('view', 'hit', 'a view: '),
    ('view', 'points', 'a view: '), ('view', 'stamp', 'a view: '),
    ('scan', 'ends', 'a scan: '), ('scan', 'pose', 'a scan: '),
    ('pair', 'R', 'a constraint: '), ('pair', 'z', 'a constraint: '),
    ('path', 'rows', 'the trail: '), ('now', 'poses', 'a checkpoint: '),
    ('now', 'P', 'a checkpoint: '), ('now', 'around', 'a checkpoint: ')])
def test_a_record_that_holds_what_cannot_be_is_refused_by_name_and_costs_no_other(
        written: tuple[bytes, Checkpoint], kind: str, name: str, told: str, wrong: str) -> None:
    """Its checksum is right: another program wrote it, or a fault of this one."""
    sound = list(records(written[0]))
    last = max(k for k, (other, _) in enumerate(sound) if other == kind)
    arrays = sound[last][1]
    changed = ABSURD[wrong](arrays[name])
    if (changed.size == 0 and name == 'around') or (wrong == 'huge and whole' and name == 'hit'):
        return
    sound[last] = kind, {**arrays, name: changed}
    found, flaws = assemble(b''.join(packed(*record) for record in sound))
    assert not flaws.damaged
    assert wrong == 'too short' or len(flaws.refused) == 1    # what is short may fit nevertheless
    assert all(what.startswith(told) and n == 1 for what, n in flaws.refused.items())
    before = written[1] if kind == 'now' and flaws.refused else assemble(written[0])[0]
    assert np.array_equal(found.poses, before.poses)
    assert len(found.scans) >= len(before.scans) - 1
    assert sum(len(cloud) == 0 for cloud in found.clouds) <= 1
    assert np.isfinite(found.graph().ekf.block(1, 1)).all()


@pytest.mark.parametrize('kind, wrong, told', [
    ('view', {'ends': np.zeros((200_000, 2)), 'reach': np.zeros(200_000),
              'hit': np.zeros(25_000, np.uint8)}, 'a view: too many ends'),
    ('view', {'k': np.array(-1)}, 'a view: k beyond all measure'),
    ('view', {'k': np.array([1, 2])}, 'a view: more than one k'),
    ('view', {'hit': np.zeros(1, np.uint8)}, 'a view: hits that do not fit the beams'),
    ('pair', {'R': np.zeros((3, 3))}, 'a constraint: R that is no covariance'),
    ('pair', {'R': -np.eye(3)}, 'a constraint: R that is no covariance'),
    ('pair', {'views': np.zeros(2)}, 'a constraint: views that are no numbers')])
def test_absurd_counts_and_covariances_are_counted_and_said(
        half: Slam, tmp_path: Path, kind: str, wrong: dict[str, Array], told: str) -> None:
    path, counted = tmp_path / 'state.map', []
    save_checkpoint(path, half.checkpoint())
    sound = list(records(path.read_bytes()))
    last = max(k for k, (other, _) in enumerate(sound) if other == kind)
    sound[last] = kind, {**sound[last][1], **wrong}
    path.write_bytes(b''.join(packed(*record) for record in sound))
    found = load_checkpoint(path, lambda *given: counted.append(given))
    assert np.array_equal(found.poses, half.views()[1])
    assert counted == [('state_records_refused', f'{path} holds what cannot be, which is left out '
                        f'of the map, though its checksums are right: {told} (1)')]
    counted.clear()
    keeper = CheckpointKeeper(str(path), 10.0, lambda *given: counted.append(given), print)
    assert len(keeper.load().poses) == len(found.poses)
    assert from_state(path).flaws == dict(counted) != {}


def test_no_file_is_no_damage(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_checkpoint(tmp_path / 'nothing.npz')


@pytest.mark.parametrize('last', [HALF + 60, len(STAMPS)])
def test_a_map_that_is_begun_anew_takes_the_place_of_the_old_one_in_the_file(
        last: int, half: Slam, tmp_path: Path) -> None:
    """Its first views were taken for written, as the old map had as many, or more."""
    path, anew = tmp_path / 'state.map', Slam(epoch=Epoch('x', 1))
    drive(anew, HALF, last)
    file = CheckpointFile(path)
    file.save(half.checkpoint())
    file.save(anew.checkpoint())
    written, again = anew.checkpoint(), load_checkpoint(path)
    assert np.array_equal(again.poses, written.poses)
    assert np.array_equal(again.stamps, written.stamps)
    for old, new in zip(written.clouds, again.clouds, strict=True):
        assert np.allclose(new.points, old.points, atol=1e-5)
    for one, other in zip(written.constraints, again.constraints, strict=True):
        assert (one.first, one.second) == (other.first, other.second)
        assert np.array_equal(one.z, other.z)


def test_the_state_of_a_robot_that_has_not_driven_yet_can_be_read(tmp_path: Path) -> None:
    evidence = np.pad(np.ones((80, 80), np.float32), 3, constant_values=-1.0)
    state = grid_checkpoint(Grid(evidence, 0.05))
    save_checkpoint(tmp_path / 'state.map', state)
    again = load_checkpoint(tmp_path / 'state.map')
    assert again.tracker.odometry is None
    assert np.array_equal(again.poses, state.poses)


def test_a_view_whose_place_was_taken_is_drawn_after_a_restart_too(tmp_path: Path) -> None:
    slam = Slam()
    drive(slam, 0, HALF // 2)
    graph, file = slam.checkpoint().graph(), CheckpointFile(tmp_path / 'state.map')
    file.save(Checkpoint.of(graph, 0, slam.checkpoint().tracker))
    graph.replace([2])
    graph.hide([3])
    file.save(Checkpoint.of(graph, 0, slam.checkpoint().tracker))
    again = load_checkpoint(tmp_path / 'state.map').graph()
    assert again.hidden == {2, 3}
    assert len(again.clouds[2]) == len(again.clouds[3].outline.reach) == 0
    assert np.array_equal(again.clouds[2].outline.ends, graph.clouds[2].outline.ends)


def test_views_of_a_piece_whose_loops_wait_still_do_once_it_is_joined(half: Slam) -> None:
    piece, graph = Slam(background=True), half.checkpoint().graph()
    drive(piece, HALF, HALF + 30)
    joined, n = piece.checkpoint().graph(), graph.ekf.n
    assert joined.to_close and not graph.to_close
    graph.join(joined, Constraint(0, n, np.zeros(3), np.eye(3)))
    assert list(graph.to_close) == [view + n for view in joined.to_close]
